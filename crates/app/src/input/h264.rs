//! What the decoder needs from an H.264 stream besides its pictures: start codes and the sequence header.
//!
//! Section and field names are those of ITU-T H.264.

use super::yuv::ColourCode;

/// The fields of a sequence parameter set (7.3.2.1.1) that say whether and how its pictures can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SequenceHeader {
    /// Columns after cropping.
    pub width: u32,
    /// Rows after cropping.
    pub height: u32,
    /// 1 is 4:2:0.
    pub chroma_format: u32,
    /// Bits a luma sample.
    pub bit_depth: u32,
    /// Pictures may be interlaced fields.
    pub interlaced: bool,
    /// Colour matrix and range from the usability information; BT.601 limited when the stream does not say.
    pub colour: ColourCode,
}

impl SequenceHeader {
    /// Parses a sequence parameter set NAL unit, header byte included; `None` when it is cut short or out of range.
    pub fn parse(nal: &[u8]) -> Option<Self> {
        let payload = without_emulation_prevention(nal.get(1..)?);
        let mut bits = Bits { bytes: &payload, at: 0 };
        let profile = bits.take(8)?;
        bits.take(16)?; // constraint flags, level
        bits.unsigned()?; // seq_parameter_set_id
        let (mut chroma_format, mut bit_depth, mut separate_planes) = (1, 8, false);
        if matches!(profile, 100 | 110 | 122 | 244 | 44 | 83 | 86 | 118 | 128 | 138 | 139 | 134 | 135) {
            chroma_format = bits.unsigned()?;
            separate_planes = chroma_format == 3 && bits.flag()?;
            bit_depth = 8 + bits.unsigned()?.max(bits.unsigned()?);
            bits.take(1)?; // qpprime_y_zero_transform_bypass_flag
            if bits.flag()? {
                bits.skip_scaling_lists(if chroma_format == 3 { 12 } else { 8 })?;
            }
        }
        bits.unsigned()?; // log2_max_frame_num_minus4
        bits.skip_picture_order_count()?;
        bits.unsigned()?; // max_num_ref_frames
        bits.take(1)?; // gaps_in_frame_num_value_allowed_flag
        let width_in_blocks = bits.unsigned()?.checked_add(1)?;
        let height_in_map_units = bits.unsigned()?.checked_add(1)?;
        let interlaced = !bits.flag()?;
        if interlaced {
            bits.take(1)?; // mb_adaptive_frame_field_flag
        }
        bits.take(1)?; // direct_8x8_inference_flag
        let crop = if bits.flag()? {
            [bits.unsigned()?, bits.unsigned()?, bits.unsigned()?, bits.unsigned()?]
        } else {
            [0; 4]
        };
        let colour = if bits.flag()? { bits.colour_code()? } else { None };

        let field_factor = if interlaced { 2 } else { 1 };
        let (unit_x, unit_y) = match (chroma_format, separate_planes) {
            (1, _) => (2, 2 * field_factor),
            (2, _) => (2, field_factor),
            _ => (1, field_factor),
        };
        let cut = |blocks: u32, unit: u32, first: u32, last: u32| {
            let crop = unit.checked_mul(first.checked_add(last)?)?;
            blocks.checked_mul(16)?.checked_sub(crop).filter(|&size| size > 0)
        };
        Some(Self {
            width: cut(width_in_blocks, unit_x, crop[0], crop[1])?,
            height: cut(height_in_map_units.checked_mul(field_factor)?, unit_y, crop[2], crop[3])?,
            chroma_format,
            bit_depth,
            interlaced,
            colour: colour.unwrap_or(ColourCode { bt709: false, full_range: false }),
        })
    }

    /// Why the bundled decoder cannot read such a stream, if so.
    pub fn unsupported(&self) -> Option<String> {
        if self.chroma_format != 1 {
            return Some(format!("chroma format {} of H.264 is not 4:2:0", self.chroma_format));
        }
        if self.bit_depth != 8 {
            return Some(format!("its samples have {} bits, not 8", self.bit_depth));
        }
        self.interlaced.then(|| "its pictures are interlaced".to_owned())
    }
}

/// Appends one NAL unit with the start code of the byte stream format (annex B).
pub(super) fn push_nal(stream: &mut Vec<u8>, nal: &[u8]) {
    stream.extend_from_slice(&[0, 0, 0, 1]);
    stream.extend_from_slice(nal);
}

/// Appends the NAL units of one MP4 sample, each of which is preceded there by its length in `length_size` bytes.
/// `false` when a length reaches past the sample.
pub(super) fn push_sample(stream: &mut Vec<u8>, mut sample: &[u8], length_size: usize) -> bool {
    while !sample.is_empty() {
        let Some((prefix, rest)) = sample.split_at_checked(length_size) else {
            return false;
        };
        let length = prefix.iter().fold(0, |length, &byte| length << 8 | usize::from(byte));
        let Some((nal, rest)) = rest.split_at_checked(length) else {
            return false;
        };
        push_nal(stream, nal);
        sample = rest;
    }
    true
}

/// Undoes 7.4.1: the byte 3 after two zeros only keeps start codes out of the payload.
fn without_emulation_prevention(nal: &[u8]) -> Vec<u8> {
    let mut payload = Vec::with_capacity(nal.len());
    let mut zeros = 0;
    for &byte in nal {
        if zeros >= 2 && byte == 3 {
            zeros = 0;
            continue;
        }
        zeros = if byte == 0 { zeros + 1 } else { 0 };
        payload.push(byte);
    }
    payload
}

/// Reads bits from the most significant one on; `None` past the end.
struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Bits<'_> {
    fn flag(&mut self) -> Option<bool> {
        let byte = self.bytes.get(self.at / 8)?;
        let bit = byte >> (7 - self.at % 8) & 1;
        self.at += 1;
        Some(bit == 1)
    }

    fn take(&mut self, count: u32) -> Option<u32> {
        let mut value = 0;
        for _ in 0..count {
            value = value << 1 | u32::from(self.flag()?);
        }
        Some(value)
    }

    /// Exp-Golomb code ue(v), 9.1.
    fn unsigned(&mut self) -> Option<u32> {
        let mut zeros = 0;
        while !self.flag()? {
            zeros += 1;
        }
        if zeros > 31 {
            return None;
        }
        Some((1_u32 << zeros) - 1 + self.take(zeros)?)
    }

    /// Exp-Golomb code se(v), 9.1.1.
    fn signed(&mut self) -> Option<i32> {
        let code = i64::from(self.unsigned()?);
        let magnitude = (code + 1) / 2;
        i32::try_from(if code % 2 == 1 { magnitude } else { -magnitude }).ok()
    }

    /// 7.3.2.1.1.1, whose values the decoder reads for itself.
    fn skip_scaling_lists(&mut self, count: usize) -> Option<()> {
        for list in 0..count {
            if !self.flag()? {
                continue;
            }
            let (mut last, mut next) = (8, 8);
            for _ in 0..if list < 6 { 16 } else { 64 } {
                if next != 0 {
                    next = (last + self.signed()?).rem_euclid(256);
                }
                if next != 0 {
                    last = next;
                }
            }
        }
        Some(())
    }

    fn skip_picture_order_count(&mut self) -> Option<()> {
        match self.unsigned()? {
            0 => {
                self.unsigned()?;
            }
            1 => {
                self.take(1)?;
                self.signed()?;
                self.signed()?;
                for _ in 0..self.unsigned()? {
                    self.signed()?;
                }
            }
            _ => {}
        }
        Some(())
    }

    /// The start of the usability information (annex E.1.1), up to the colour matrix.
    #[expect(
        clippy::option_option,
        reason = "outside: the header is complete; inside: it names a colour code"
    )]
    fn colour_code(&mut self) -> Option<Option<ColourCode>> {
        const EXTENDED_ASPECT: u32 = 255;
        if self.flag()? && self.take(8)? == EXTENDED_ASPECT {
            self.take(32)?;
        }
        if self.flag()? {
            self.take(1)?; // overscan_appropriate_flag
        }
        if !self.flag()? {
            return Some(None);
        }
        self.take(3)?; // video_format
        let full_range = self.flag()?;
        let matrix = if self.flag()? { self.take(24)? & 0xff } else { 2 };
        Some(Some(ColourCode { bt709: matrix == 1, full_range }))
    }
}
