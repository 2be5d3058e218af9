//! Images (spec sections 11 and 16): a header and rows of pixels, each row padded.

use super::shape;
use crate::{Bottle, DecodeError, Dialect, Value, Vocab};

/// Pixel format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelCode(pub Vocab);

impl PixelCode {
    /// No pixels: the code of an empty image.
    pub const NONE: PixelCode = PixelCode(Vocab(0));
    /// Gray, one byte.
    pub const MONO: PixelCode = PixelCode(Vocab::new("mono"));
    /// Gray, two bytes.
    pub const MONO16: PixelCode = PixelCode(Vocab::new("mo16"));
    /// Red, green, blue.
    pub const RGB: PixelCode = PixelCode(Vocab::new("rgb"));
    /// Blue, green, red.
    pub const BGR: PixelCode = PixelCode(Vocab::new("bgr"));
    /// Red, green, blue, opacity.
    pub const RGBA: PixelCode = PixelCode(Vocab::new("rgba"));
    /// Blue, green, red, opacity.
    pub const BGRA: PixelCode = PixelCode(Vocab::new("bgra"));
    /// A float of 32 bits, such as a depth.
    pub const FLOAT: PixelCode = PixelCode(Vocab::new("dec"));

    /// All codes of YARP, with their bytes per pixel.
    pub const ALL: [(PixelCode, usize); 22] = {
        const fn code(letters: &str, size: usize) -> (PixelCode, usize) {
            (PixelCode(Vocab::new(letters)), size)
        }
        [
            code("mono", 1),
            code("mo16", 2),
            code("rgb", 3),
            code("bgr", 3),
            code("rgba", 4),
            code("bgra", 4),
            code("int", 4),
            code("hsv", 3),
            code("sign", 1),
            code("rgb-", 3),
            code("rgbi", 12),
            code("dec", 4),
            code("rgb.", 12),
            code("hsv.", 12),
            code("grbg", 1),
            code("bggr", 1),
            code("gbrg", 1),
            code("rggb", 1),
            // Bayer patterns of 16 bits
            code("gr16", 2),
            code("bg16", 2),
            code("gb16", 2),
            code("rg16", 2),
        ]
    };

    /// Bytes per pixel; `None` for an unknown code.
    pub fn bytes(self) -> Option<usize> {
        if self == PixelCode::NONE {
            return Some(0);
        }
        PixelCode::ALL.iter().find(|(code, _)| *code == self).map(|(_, bytes)| *bytes)
    }
}

/// An image. Row 0 is the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixel format.
    pub pixel: PixelCode,
    /// Pixels per row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// Alignment of rows, bytes; 0 only for an empty image.
    pub quantum: u16,
    /// Flag that the first row is the top. It differs among versions of YARP for the same orientation and
    /// must be ignored.
    pub top: u16,
    /// Rows, each padded. The padding is meaningless.
    pub rows: Vec<u8>,
}

const WHAT: &str = "an image";

impl Image {
    /// Image without pixels.
    pub const EMPTY: Image =
        Image { pixel: PixelCode::NONE, width: 0, height: 0, quantum: 0, top: 0, rows: Vec::new() };

    /// Creates an image from pixels, row by row without gaps; it gets YARP's usual quantum of 8.
    ///
    /// # Errors
    /// The pixel format is unknown, or the number of pixels is not `width` times `height`.
    pub fn new(pixel: PixelCode, width: u32, height: u32, pixels: &[u8]) -> Result<Image, DecodeError> {
        let mut image = Image { pixel, width, height, quantum: 8, top: 0, rows: Vec::new() };
        let (used, row) = image.layout()?;
        if used.checked_mul(wide(height)) != Some(pixels.len()) {
            return Err(shape(WHAT, format!("{} bytes are not {width}x{height} pixels", pixels.len())));
        }
        if used > 0 {
            image.rows.reserve_exact(row.saturating_mul(wide(height)));
            for pixels in pixels.chunks_exact(used) {
                image.rows.extend_from_slice(pixels);
                image.rows.resize(image.rows.len() + row - used, 0);
            }
        }
        Ok(image)
    }

    /// Bytes of a row's pixels, and of a padded row.
    fn layout(&self) -> Result<(usize, usize), DecodeError> {
        let bytes = self.pixel.bytes();
        let bytes = bytes.ok_or_else(|| shape(WHAT, format!("unknown pixel code {:?}", self.pixel.0)))?;
        if wide(self.width).saturating_mul(wide(self.height)).saturating_mul(bytes) == 0 {
            return Ok((0, 0));
        }
        if self.quantum == 0 {
            return Err(shape(WHAT, "its quantum is 0"));
        }
        let used = wide(self.width).saturating_mul(bytes);
        let row = used.checked_next_multiple_of(usize::from(self.quantum));
        Ok((used, row.ok_or_else(|| shape(WHAT, "its rows are too long"))?))
    }

    /// Pixels of row `y`, without the padding; `None` below the image.
    pub fn row(&self, y: u32) -> Option<&[u8]> {
        let (used, row) = self.layout().ok()?;
        let start = wide(y).checked_mul(row).filter(|_| used > 0 && y < self.height)?;
        self.rows.get(start..start.checked_add(used)?)
    }

    /// All pixels, row by row, without the padding.
    pub fn pixels(&self) -> Vec<u8> {
        (0..self.height).map_while(|y| self.row(y)).flatten().copied().collect()
    }

    /// Bytes of the message, the same in both dialects.
    pub fn encode(&self) -> Vec<u8> {
        let mut out = self.header(Vec::new()).encode(Dialect::V3);
        out.truncate(out.len().saturating_sub(4)); // removes the length of the empty pixels
        out.reserve_exact(4 + self.rows.len());
        out.extend(i32::try_from(self.rows.len()).unwrap_or(i32::MAX).to_le_bytes());
        out.extend_from_slice(&self.rows);
        out
    }

    /// Converts to a bottle, for its text: `[mat] [rgb] (3 32 65544 3 2) {bytes}`.
    pub fn to_bottle(&self) -> Bottle {
        self.header(self.rows.clone())
    }

    fn header(&self, rows: Vec<u8>) -> Bottle {
        let word = |x: usize| i32::try_from(x).unwrap_or(i32::MAX);
        let quantum = u32::from(self.quantum) | u32::from(self.top) << 16;
        Bottle::new()
            .with(Vocab::new("mat"))
            .with(self.pixel.0)
            .with(Bottle::of([
                word(self.pixel.bytes().unwrap_or(0)),
                word(self.rows.len()),
                i32::from_le_bytes(quantum.to_le_bytes()),
                word(wide(self.width)),
                word(wide(self.height)),
            ]))
            .with(rows)
    }

    /// Decodes an image.
    ///
    /// # Errors
    /// The bytes are not an image, or its sizes are inconsistent.
    pub fn decode(bytes: &[u8], dialect: Dialect) -> Result<Image, DecodeError> {
        Image::from_bottle(Bottle::decode(bytes, dialect)?)
    }

    /// Converts a bottle to an image.
    ///
    /// # Errors
    /// As [`Image::decode`].
    pub fn from_bottle(bottle: Bottle) -> Result<Image, DecodeError> {
        let parts: Result<[Value; 4], _> = bottle.0.try_into();
        let Ok([Value::Vocab(mat), Value::Vocab(pixel), Value::List(sizes), Value::Blob(rows)]) = parts else {
            return Err(shape(WHAT, "it is not [mat], a pixel code, five sizes and the pixels"));
        };
        let sizes = super::vector::i32_from_bottle(&sizes)?;
        let [bytes, size, quantum, width, height] = sizes.as_slice() else {
            return Err(shape(WHAT, "it does not state five sizes"));
        };
        let (Ok(width), Ok(height)) = (u32::try_from(*width), u32::try_from(*height)) else {
            return Err(shape(WHAT, format!("it is {width}x{height} pixels")));
        };
        let [q0, q1, t0, t1] = quantum.to_le_bytes();
        let quantum = u16::from_le_bytes([q0, q1]);
        let top = u16::from_le_bytes([t0, t1]);
        let image = Image { pixel: PixelCode(pixel), width, height, quantum, top, rows };
        let (_, row) = image.layout()?;
        let expected = row.checked_mul(wide(height));
        if mat != Vocab::new("mat") {
            return Err(shape(WHAT, "it does not begin with [mat]"));
        }
        if usize::try_from(*bytes).ok() != image.pixel.bytes() && !image.rows.is_empty() {
            return Err(shape(WHAT, format!("{:?} pixels do not have {bytes} bytes", image.pixel.0)));
        }
        if expected != Some(image.rows.len()) || usize::try_from(*size).ok() != expected {
            let why = format!("{width}x{height} pixels in {} bytes, {size} stated", image.rows.len());
            return Err(shape(WHAT, why));
        }
        Ok(image)
    }
}

fn wide(n: u32) -> usize {
    usize::try_from(n).unwrap_or(usize::MAX)
}
