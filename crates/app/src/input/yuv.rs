//! YUV 4:2:0 planes to RGB.

use super::RgbFrame;

/// Which YUV the numbers of a video are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ColourCode {
    /// BT.709 coefficients; otherwise BT.601, which is also what OpenCV and ffmpeg take for an untagged video.
    pub bt709: bool,
    /// Luma runs over 0..=255; otherwise 16..=235.
    pub full_range: bool,
}

/// One decoded picture: a luma plane and two chroma planes of half its width and height (rounded up).
pub(super) struct Planes<'a> {
    pub width: usize,
    pub height: usize,
    pub luma: &'a [u8],
    pub chroma: [&'a [u8]; 2],
    pub luma_stride: usize,
    pub chroma_stride: usize,
}

/// Contributions to red, green and blue in 1/65536, so that a pixel takes additions and shifts only.
struct Coefficients {
    luma_offset: i32,
    luma: i32,
    red_v: i32,
    green_u: i32,
    green_v: i32,
    blue_u: i32,
}

impl Coefficients {
    fn new(code: ColourCode) -> Self {
        // ITU-R BT.601-7 and BT.709-6: weights of red and blue in luma.
        let (k_red, k_blue) = if code.bt709 { (0.2126, 0.0722) } else { (0.299, 0.114) };
        let k_green = 1.0 - k_red - k_blue;
        let (luma_offset, luma_gain, chroma_gain) =
            if code.full_range { (0, 1.0, 1.0) } else { (16, 255.0 / 219.0, 255.0 / 224.0) };
        let fixed = |value: f64| (value * 65536.0).round() as i32;
        Self {
            luma_offset,
            luma: fixed(luma_gain),
            red_v: fixed(2.0 * (1.0 - k_red) * chroma_gain),
            green_u: fixed(-2.0 * (1.0 - k_blue) * k_blue / k_green * chroma_gain),
            green_v: fixed(-2.0 * (1.0 - k_red) * k_red / k_green * chroma_gain),
            blue_u: fixed(2.0 * (1.0 - k_blue) * chroma_gain),
        }
    }
}

/// Converts `planes` into `frame`. The four luma samples over a chroma sample share it, as in ffmpeg's default.
pub(super) fn rgb_from_yuv420(planes: &Planes<'_>, code: ColourCode, frame: &mut RgbFrame) {
    let c = Coefficients::new(code);
    frame.resize(planes.width as u32, planes.height as u32);
    for (y, out) in frame.pixels.chunks_exact_mut(3 * planes.width).enumerate() {
        let luma = &planes.luma[y * planes.luma_stride..][..planes.width];
        let chroma_start = y / 2 * planes.chroma_stride;
        let chroma_width = planes.width.div_ceil(2);
        let u_row = &planes.chroma[0][chroma_start..][..chroma_width];
        let v_row = &planes.chroma[1][chroma_start..][..chroma_width];
        let pairs = out.chunks_mut(6).zip(luma.chunks(2)).zip(u_row.iter().zip(v_row));
        for ((out, luma), (&u, &v)) in pairs {
            let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
            let half = 1 << 15;
            let red = c.red_v * v + half;
            let green = c.green_u * u + c.green_v * v + half;
            let blue = c.blue_u * u + half;
            for (rgb, &y) in out.chunks_exact_mut(3).zip(luma) {
                let y = (i32::from(y) - c.luma_offset) * c.luma;
                rgb[0] = ((y + red) >> 16).clamp(0, 255) as u8;
                rgb[1] = ((y + green) >> 16).clamp(0, 255) as u8;
                rgb[2] = ((y + blue) >> 16).clamp(0, 255) as u8;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixel(code: ColourCode, [y, u, v]: [u8; 3]) -> [u8; 3] {
        let planes = Planes {
            width: 1,
            height: 1,
            luma: &[y],
            chroma: [&[u], &[v]],
            luma_stride: 1,
            chroma_stride: 1,
        };
        let mut frame = RgbFrame::default();
        rgb_from_yuv420(&planes, code, &mut frame);
        [frame.pixels[0], frame.pixels[1], frame.pixels[2]]
    }

    /// The 100 % colour bars as the two standards tabulate them (limited range, 8 bits).
    #[test]
    fn colour_bars_of_the_standards() {
        let near = |a: [u8; 3], b: [u8; 3]| a.iter().zip(&b).all(|(a, b)| a.abs_diff(*b) <= 2);
        let bt601 = ColourCode { bt709: false, full_range: false };
        let bt709 = ColourCode { bt709: true, full_range: false };
        let bars = [
            ([235, 128, 128], [235, 128, 128], [255, 255, 255]),
            ([81, 90, 240], [63, 102, 240], [255, 0, 0]),
            ([145, 54, 34], [173, 42, 26], [0, 255, 0]),
            ([41, 240, 110], [32, 240, 118], [0, 0, 255]),
            ([16, 128, 128], [16, 128, 128], [0, 0, 0]),
        ];
        for (yuv601, yuv709, rgb) in bars {
            assert!(near(pixel(bt601, yuv601), rgb), "{:?}", pixel(bt601, yuv601));
            assert!(near(pixel(bt709, yuv709), rgb), "{:?}", pixel(bt709, yuv709));
        }
        assert!(!near(pixel(bt601, [63, 102, 240]), [255, 0, 0]), "the two codes differ");
        let full = ColourCode { bt709: false, full_range: true };
        assert_eq!(pixel(full, [200, 128, 128]), [200, 200, 200]);
    }
}
