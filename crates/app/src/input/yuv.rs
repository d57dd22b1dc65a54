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

/// Luma samples that are converted at a time: a fixed number, and loops that do one thing each, so that the compiler
/// works on many samples at once (ten times faster than pixel by pixel).
const BLOCK: usize = 64;

impl Coefficients {
    /// Red, green and blue of neighbouring samples; two luma samples share a chroma sample.
    fn convert(&self, luma: &[u8; BLOCK], u: &[u8; BLOCK / 2], v: &[u8; BLOCK / 2]) -> [[u8; BLOCK]; 3] {
        const HALF: i32 = 1 << 15;
        let mut tint = [[0; BLOCK]; 3];
        for (i, (&u, &v)) in u.iter().zip(v).enumerate() {
            let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
            let pair = [self.red_v * v, self.green_u * u + self.green_v * v, self.blue_u * u];
            for (channel, tint) in tint.iter_mut().enumerate() {
                let value = pair[channel] + HALF;
                (tint[2 * i], tint[2 * i + 1]) = (value, value);
            }
        }
        let mut rgb = [[0; BLOCK]; 3];
        for (channel, values) in rgb.iter_mut().enumerate() {
            let tint = &tint[channel];
            for (i, value) in values.iter_mut().enumerate() {
                let y = (i32::from(luma[i]) - self.luma_offset) * self.luma;
                *value = ((y + tint[i]) >> 16).clamp(0, 255) as u8;
            }
        }
        rgb
    }
}

/// Converts `planes` into `frame`. The four luma samples over a chroma sample share it, as in ffmpeg's default.
pub(super) fn rgb_from_yuv420(planes: &Planes<'_>, code: ColourCode, frame: &mut RgbFrame) {
    let coefficients = Coefficients::new(code);
    let chroma_width = planes.width.div_ceil(2);
    let (mut luma, mut u, mut v) = ([0; BLOCK], [0; BLOCK / 2], [0; BLOCK / 2]);
    frame.resize(planes.width as u32, planes.height as u32);
    for (y, row) in frame.pixels.chunks_exact_mut(3 * planes.width).enumerate() {
        let luma_row = &planes.luma[y * planes.luma_stride..][..planes.width];
        let chroma_start = y / 2 * planes.chroma_stride;
        let [u_row, v_row] = planes.chroma.map(|plane| &plane[chroma_start..][..chroma_width]);
        let chroma_blocks = u_row.chunks(BLOCK / 2).zip(v_row.chunks(BLOCK / 2));
        for ((out, block), (u_block, v_block)) in
            row.chunks_mut(3 * BLOCK).zip(luma_row.chunks(BLOCK)).zip(chroma_blocks)
        {
            luma[..block.len()].copy_from_slice(block);
            u[..u_block.len()].copy_from_slice(u_block);
            v[..v_block.len()].copy_from_slice(v_block);
            let [red, green, blue] = coefficients.convert(&luma, &u, &v);
            for (i, pixel) in out.as_chunks_mut().0.iter_mut().enumerate() {
                *pixel = [red[i], green[i], blue[i]];
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
