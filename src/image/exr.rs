//! OpenEXR files: writes one scanline part of f32 channels, and also reads files that other programs have written.

mod tags;

use std::collections::HashSet;
use std::io::{self, Cursor, Write};
use std::panic::{UnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::{fmt, fs};

use ::exr::block::reader::ChunksReader;
use ::exr::block::{UncompressedBlock, lines::LineRef};
use ::exr::error::Error as ExrError;
use ::exr::image::write::WritableImage;
use ::exr::image::{AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Layer};
use ::exr::math::Vec2;
use ::exr::meta::attribute::{ChannelDescription, LineOrder, SampleType, Text};
use ::exr::meta::header::Header;
use ::exr::prelude::{Compression, f16};

use super::file::atomic_write;
use super::{Extent, Image, ImageError, RgbImage};
pub use tags::Tags;

/// Compression of written files. RLE shrinks flat AOVs. Noisy radiance hardly shrinks with any lossless method, and ZIP
/// is slow on it.
const COMPRESSION: Compression = Compression::RLE;

/// Writes channels R, G and B as f32. Equal pixels give equal bytes; NaN and infinities are kept.
///
/// # Errors
/// [`ImageError::Write`].
pub fn write_rgb(path: &Path, image: &RgbImage) -> Result<(), ImageError> {
    write_tagged_rgb(path, image, &Tags::default())
}

/// Writes like [`write_rgb`], with metadata as attributes.
///
/// # Errors
/// [`ImageError::Write`].
pub fn write_tagged_rgb(path: &Path, image: &RgbImage, tags: &Tags) -> Result<(), ImageError> {
    let plane = |c: usize| image.pixels.iter().map(|p| p[c]).collect::<Vec<f32>>();
    let (r, g, b) = (plane(0), plane(1), plane(2));
    write_tagged_channels(path, image.extent, &[("R", &r), ("G", &g), ("B", &b)], tags)
}

/// Writes named f32 channels, each with `extent.area()` values in row-major order from the top left, and metadata as
/// attributes.
///
/// # Errors
/// [`ImageError::Write`], also for a wrong number of values and for empty or duplicate names.
pub fn write_tagged_channels(
    path: &Path,
    extent: Extent,
    channels: &[(&str, &[f32])],
    tags: &Tags,
) -> Result<(), ImageError> {
    atomic_write(path, |file| {
        let list = channels.iter().map(|&(name, samples)| channel(extent, name, samples)).collect::<io::Result<_>>()?;
        let encoding =
            Encoding { compression: COMPRESSION, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
        let size = (extent.width as usize, extent.height as usize);
        let layer = Layer::new(size, tags.attributes(extent), encoding, AnyChannels::sort(list));
        let mut bytes = Vec::new();
        ::exr::image::Image::from_layer(layer).write().to_buffered(Cursor::new(&mut bytes)).map_err(io_error)?;
        tags::sort(&mut bytes);
        file.write_all(&bytes)
    })
}

fn channel(extent: Extent, name: &str, samples: &[f32]) -> io::Result<AnyChannel<FlatSamples>> {
    let invalid = |what: String| io::Error::new(io::ErrorKind::InvalidInput, what);
    let text = Text::new_or_none(name).ok_or_else(|| invalid(format!("'{name}' cannot name a channel")))?;
    if samples.len() != extent.area() {
        return Err(invalid(format!("channel {name} has {} values for {extent} pixels", samples.len())));
    }
    Ok(AnyChannel::new(text, FlatSamples::F32(samples.to_vec())))
}

fn io_error(error: ExrError) -> io::Error {
    match error {
        ExrError::Io(e) => e,
        other => io::Error::new(io::ErrorKind::InvalidData, other.to_string()),
    }
}

/// Colour image of a file, with its source channels and metadata.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourFile {
    pub image: RgbImage,
    pub source: ColourSource,
    pub tags: Tags,
}

/// Reads a file like [`read_colour`], and returns only the image.
///
/// # Errors
/// Errors of [`read_colour`].
pub fn read_rgb(path: &Path) -> Result<RgbImage, ImageError> {
    read_colour(path).map(|file| file.image)
}

/// Reads the colour of an OpenEXR file with scanlines or tiles of half, float or uint values, at the largest resolution
/// level.
///
/// Takes the first part with channels R, G and B. If there is none, takes the first layer that has them (`diffuse.R`
/// …). If there is none either, takes Y or a single channel as grey. The image is the display window: pixels outside of it
/// are dropped, and those that the file lacks are black. Alpha is ignored.
///
/// # Errors
/// [`ImageError::Read`], [`ImageError::Decode`] for a damaged file, [`ImageError::Unsupported`] for deep data,
/// subsampled channels and the compressions DWA, HTJ2K and ZSTD, [`ImageError::NoColour`].
pub fn read_colour(path: &Path) -> Result<ColourFile, ImageError> {
    read(path, Colour::find, |path, channels| ImageError::NoColour { path, channels })
}

/// Reads three channels by name, ignoring case, from the first part that has them. A name may be repeated. Formats are
/// those of [`read_colour`].
///
/// # Errors
/// Errors of [`read_colour`], with [`ImageError::NoChannels`] for a file without these channels.
pub fn read_channels(path: &Path, names: [&'static str; 3]) -> Result<ColourFile, ImageError> {
    read_layer(path, "", names)
}

/// Reads three channels of a layer like [`read_channels`]. The layer's name ends in a dot, as in `normal.X`; it is empty
/// for channels without one.
///
/// # Errors
/// Errors of [`read_channels`].
pub fn read_layer(path: &Path, layer: &str, names: [&'static str; 3]) -> Result<ColourFile, ImageError> {
    let wanted = || names.map(|name| format!("{layer}{name}")).join(", ");
    let lacks = |path, channels| ImageError::NoChannels { path, wanted: wanted(), channels };
    read(path, |headers| Colour::first(headers, |list| channels_of_layer(list, layer, names)), lacks)
}

/// Decodes a file's `bytes` like [`read_rgb`] if decoding takes at most `max_memory` further bytes.
///
/// # Errors
/// Errors of [`read_colour`], and [`ImageError::TooLarge`].
pub fn decode_rgb(path: &Path, bytes: &[u8], max_memory: u64) -> Result<RgbImage, ImageError> {
    let lacks = |path, channels| ImageError::NoColour { path, channels };
    read_bytes(path, bytes, max_memory, Colour::find, lacks).map(|file| file.image)
}

/// Reads the channels that `find` chooses. If `find` returns `None`, `lacks` makes the error from the path and the
/// names of all channels in the file.
fn read(
    path: &Path,
    find: impl Fn(&[Header]) -> Option<Colour> + UnwindSafe,
    lacks: impl Fn(PathBuf, String) -> ImageError,
) -> Result<ColourFile, ImageError> {
    let bytes = fs::read(path).map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
    read_bytes(path, &bytes, u64::MAX, find, lacks)
}

fn read_bytes(
    path: &Path,
    bytes: &[u8],
    max_memory: u64,
    find: impl Fn(&[Header]) -> Option<Colour> + UnwindSafe,
    lacks: impl Fn(PathBuf, String) -> ImageError,
) -> Result<ColourFile, ImageError> {
    // The B44 decoder of the exr crate overflows on damaged blocks, which panics if overflow checks are on. Cargo.toml
    // turns them off for that crate in our own builds.
    let decoded = catch_unwind(|| decode(bytes, max_memory, find))
        .unwrap_or_else(|_| Err(Refusal::Unreadable("its compressed data is damaged".into())));
    decoded.map_err(|e| match e {
        Refusal::Unreadable(reason) => ImageError::Decode { path: path.to_owned(), reason },
        Refusal::TooLarge(needed) => ImageError::TooLarge { path: path.to_owned(), needed },
        Refusal::Unsupported(what) => ImageError::Unsupported { path: path.to_owned(), what },
        Refusal::NotThere(channels) => lacks(path.to_owned(), channels),
    })
}

/// Part and channels of a file from which its colour was read.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct ColourSource {
    /// Index of the part, from 0.
    pub part: usize,
    pub part_count: usize,
    pub part_name: Option<String>,
    /// Names of the channels read as red, green and blue.
    pub channels: [String; 3],
}

impl ColourSource {
    /// Returns true if the colour was unambiguous: the file has one part, and its channels R, G and B were read.
    pub fn is_plain(&self) -> bool {
        self.part_count == 1 && self.channels.iter().zip(["R", "G", "B"]).all(|(name, plain)| name == plain)
    }
}

impl fmt::Display for ColourSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "channels {}", self.channels.join(", "))?;
        if self.part_count > 1 {
            write!(f, " of part {} of {}", self.part + 1, self.part_count)?;
            if let Some(name) = &self.part_name {
                write!(f, ", \"{name}\"")?;
            }
        }
        Ok(())
    }
}

/// An [`ImageError`] without the path.
enum Refusal {
    Unreadable(String),
    Unsupported(String),
    /// Number of bytes that decoding would take.
    TooLarge(u64),
    /// The wanted channels are missing; holds the names of the channels that the file has.
    NotThere(String),
}

impl From<ExrError> for Refusal {
    fn from(error: ExrError) -> Self {
        match error {
            ExrError::NotSupported(what) => Self::Unsupported(what.into_owned()),
            other => Self::Unreadable(other.to_string()),
        }
    }
}

fn decode(bytes: &[u8], max_memory: u64, find: impl Fn(&[Header]) -> Option<Colour>) -> Result<ColourFile, Refusal> {
    let reader = ::exr::block::read(Cursor::new(bytes), false)?;
    check_headers(reader.headers(), bytes.len())?;
    let colour = find(reader.headers()).ok_or_else(|| Refusal::NotThere(channel_names(reader.headers())))?;
    let source = colour.source(reader.headers());
    let header = &reader.headers()[colour.part];
    let tags = Tags::of(header);
    let picture = header.shared_attributes.display_window;
    let needed = decoding_bytes(header, bytes.len());
    if needed > max_memory {
        return Err(Refusal::TooLarge(needed));
    }
    let mut image = Image::filled(Extent::new(picture.size.0 as u32, picture.size.1 as u32), [0.0; 3]);
    let data = header.own_attributes.layer_position;
    let axes = [(data.0, picture.position.0), (data.1, picture.position.1)];
    let offset = axes.map(|(to, from)| i64::from(to) - i64::from(from));
    let mut seen = HashSet::new();
    reader
        .filter_chunks(false, |_, tile, block| block.layer == colour.part && tile.is_largest_resolution_level())?
        .decompress_sequential(false, |meta, block| {
            // A damaged offset table may lead to another part or level.
            let of_this_image = block.index.layer == colour.part && block.index.level == Vec2(0, 0);
            if !of_this_image || !seen.insert(block.index.pixel_position) {
                return Err(ExrError::Invalid("the offset table leads to a wrong block".into()));
            }
            colour.copy_block(&meta.headers[colour.part], &block, offset, &mut image)
        })?;
    Ok(ColourFile { image, source, tags })
}

/// Rejects headers that claim far more data than the file can hold, before they cause allocations: deflate, the
/// strongest of the lossless compressions, compresses by at most 1032:1. Pictures larger than their data are bounded as
/// well. Rejects DWA because the decoder of the exr crate allocates as much memory as a damaged block asks for.
fn check_headers(headers: &[Header], file_bytes: usize) -> Result<(), Refusal> {
    const LARGEST_SIDE: usize = 1 << 16;
    const LARGEST_BLACK: usize = 1 << 26;
    let allowed = 2048 * file_bytes as u128;
    for header in headers {
        if matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
            return Err(Refusal::Unsupported("DWA compression".into()));
        }
        let (data, picture) = (header.layer_size, header.shared_attributes.display_window.size);
        let claimed = data.0 as u128 * data.1 as u128 * header.channels.bytes_per_pixel as u128;
        let is_image = |size: Vec2<usize>| [size.0, size.1].iter().all(|side| (1..=LARGEST_SIDE).contains(side));
        if !is_image(data) || claimed > allowed {
            return Err(Refusal::Unreadable(format!("{}x{} pixels in {file_bytes} bytes", data.0, data.1)));
        }
        if !is_image(picture) || picture.area() > LARGEST_BLACK.max(data.area()) {
            return Err(Refusal::Unreadable(format!("its display window has {}x{} pixels", picture.0, picture.1)));
        }
    }
    Ok(())
}

/// Returns an upper bound on the memory for decoding a part, in bytes: the image, several copies of a block, and lists
/// of the blocks in the offset table.
fn decoding_bytes(header: &Header, file_bytes: usize) -> u64 {
    const STATES_OF_BLOCK: usize = 4;
    const LISTS_PER_FILE_BYTE: usize = 24;
    let pixels = header.shared_attributes.display_window.size.area().saturating_mul(size_of::<[f32; 3]>());
    let block = header.max_block_byte_size().saturating_mul(STATES_OF_BLOCK);
    pixels.saturating_add(block).saturating_add(file_bytes.saturating_mul(LISTS_PER_FILE_BYTE)) as u64
}

fn channel_names(headers: &[Header]) -> String {
    let names: Vec<_> = headers.iter().flat_map(|h| &h.channels.list).map(|c| c.name.to_string()).collect();
    names.join(", ")
}

/// Location of the colour in a file: a part, and the indices of its red, green and blue channels.
struct Colour {
    part: usize,
    channels: [usize; 3],
}

impl Colour {
    /// Finds the colour in the first part in which `choose` finds channels.
    fn first(headers: &[Header], choose: impl Fn(&[ChannelDescription]) -> Option<[usize; 3]>) -> Option<Self> {
        let mut parts = headers.iter().enumerate().filter(|(_, h)| !h.deep);
        parts.find_map(|(part, header)| choose(&header.channels.list).map(|channels| Self { part, channels }))
    }

    fn find(headers: &[Header]) -> Option<Self> {
        let first = |choose: fn(&[ChannelDescription]) -> Option<[usize; 3]>| Self::first(headers, choose);
        first(|list| rgb_of_layer(list, ""))
            .or_else(|| first(|list| list.iter().find_map(|c| rgb_of_layer(list, layer_of(&c.name.to_string())))))
            .or_else(|| first(luminance))
    }

    fn source(&self, headers: &[Header]) -> ColourSource {
        let header = &headers[self.part];
        ColourSource {
            part: self.part,
            part_count: headers.len(),
            part_name: header.own_attributes.layer_name.as_ref().map(Text::to_string),
            channels: self.channels.map(|c| header.channels.list[c].name.to_string()),
        }
    }

    /// Copies a block of the data window, whose corner is at `offset` in the image.
    fn copy_block(
        &self,
        header: &Header,
        block: &UncompressedBlock,
        offset: [i64; 2],
        image: &mut RgbImage,
    ) -> Result<(), ExrError> {
        for line in block.lines(&header.channels) {
            let channel = line.location.channel;
            if self.channels.contains(&channel) {
                match header.channels.list[channel].sample_type {
                    SampleType::F16 => self.copy_line::<f16>(line, f16::to_f32, offset, image)?,
                    SampleType::F32 => self.copy_line::<f32>(line, |v| v, offset, image)?,
                    SampleType::U32 => self.copy_line::<u32>(line, |v| v as f32, offset, image)?,
                }
            }
        }
        Ok(())
    }

    fn copy_line<T: ::exr::io::Data>(
        &self,
        line: LineRef<'_>,
        value: fn(T) -> f32,
        [right, down]: [i64; 2],
        image: &mut RgbImage,
    ) -> Result<(), ExrError> {
        let at = line.location;
        let (left, width) = (at.position.0 as i64 + right, image.extent.width as usize);
        let row = usize::try_from(at.position.1 as i64 + down).unwrap_or(usize::MAX);
        let Some(pixels) = image.pixels.chunks_exact_mut(width).nth(row) else { return Ok(()) };
        let Some(pixels) = pixels.get_mut(left.max(0) as usize..) else { return Ok(()) };
        let hidden = left.min(0).unsigned_abs() as usize;
        for (pixel, sample) in pixels.iter_mut().zip(line.read_samples::<T>().skip(hidden)) {
            let sample = value(sample?);
            for (c, slot) in pixel.iter_mut().enumerate() {
                if self.channels[c] == at.channel {
                    *slot = sample;
                }
            }
        }
        Ok(())
    }
}

/// Returns the layer's prefix of a channel's name: `diffuse.` of `diffuse.R`, empty for `R`.
fn layer_of(name: &str) -> &str {
    name.rfind('.').map_or("", |dot| &name[..=dot])
}

fn rgb_of_layer(list: &[ChannelDescription], layer: &str) -> Option<[usize; 3]> {
    channels_of_layer(list, layer, ["R", "G", "B"])
}

fn channels_of_layer(list: &[ChannelDescription], layer: &str, names: [&str; 3]) -> Option<[usize; 3]> {
    let index = |c: &str| list.iter().position(|d| d.name.eq_case_insensitive(&format!("{layer}{c}")));
    let [a, b, c] = names.map(index);
    Some([a?, b?, c?])
}

fn luminance(list: &[ChannelDescription]) -> Option<[usize; 3]> {
    let y = list.iter().position(|c| c.name.eq_case_insensitive("Y"));
    y.or((list.len() == 1).then_some(0)).map(|i| [i; 3])
}

#[cfg(test)]
mod tests;
