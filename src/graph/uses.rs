//! The declaration of a binding of a pass: its image, the access to it, and the rows that are read.

use std::ops::Range;

use super::resource::{Image, Life};
use super::rows::widen;
use crate::scene::rig::Eye;
use crate::wgsl::Texel;

/// Access of a pass to an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    Read,
    /// Writes every texel of its rows.
    Write,
    /// Writes every texel of its rows, and reads back only its own writes.
    WriteThenRead,
    /// Changes some texels, idempotently: a second run leaves the same result.
    Update,
    /// Adds to every texel.
    Add,
}

impl Access {
    /// Returns true if this access needs the output of earlier passes.
    pub fn reads(self) -> bool {
        matches!(self, Self::Read | Self::Update | Self::Add)
    }

    pub fn writes(self) -> bool {
        self != Self::Read
    }
}

/// Rows of an image that a pass reads in order to compute its own rows.
#[derive(Clone, Copy, Debug)]
pub enum Reach {
    Own,
    /// Also this many rows above and below.
    Halo(u32),
    /// All blocks of `size` rows that contain its own rows. The first block begins `offset` rows above the image.
    Blocks {
        size: u32,
        offset: u32,
    },
    All,
    /// The rows that this function returns. Its argument is the range of the pass's own rows, scaled to the image that
    /// is read; the result is also in rows of that image.
    Rows(fn(Range<u32>) -> Range<u32>),
}

impl Reach {
    /// Returns the rows that are read for the rows `own` of an image with `height` rows.
    pub fn rows(self, own: &Range<u32>, height: u32) -> Range<u32> {
        match self {
            Self::Own => own.clone(),
            Self::Halo(rows) => widen(own, rows, height),
            Self::Blocks { size, offset } => {
                let size = size.max(1);
                let begin = (own.start + offset) / size * size;
                let end = (own.end + offset).next_multiple_of(size);
                begin.saturating_sub(offset)..(end - offset).min(height)
            }
            Self::All => 0..height,
            Self::Rows(map) => {
                let rows = map(own.clone());
                rows.start.min(height)..rows.end.min(height)
            }
        }
    }

    /// Returns the number of rows read above and below, which is 0 unless this is a [`Self::Halo`].
    pub fn halo_rows(self) -> u32 {
        if let Self::Halo(rows) = self { rows } else { 0 }
    }
}

/// One binding of a pass.
#[derive(Clone, Copy, Debug)]
pub struct Use {
    pub image: Image,
    pub access: Access,
    pub reach: Reach,
    /// True if the pass binds the image of the previous frame.
    pub is_before: bool,
    /// The eye whose image is bound. By default it is the eye of the pass.
    pub eye: Option<Eye>,
    /// True if the image may be bound although no pass has written it. The shader then does not read it.
    pub is_optional: bool,
    /// True if the image is cleared to 0 before the pass. In a list, only the counts are cleared.
    pub is_cleared: bool,
    /// Name of the shader's variable, if it does not follow from the resource.
    pub name: Option<&'static str>,
    /// WGSL type of the elements in the shader, if it differs from the resource's element type.
    pub element: Option<&'static str>,
}

impl Use {
    fn new(image: impl Into<Image>, access: Access) -> Self {
        let image = image.into();
        let (reach, eye, name, element) = (Reach::Own, None, None, None);
        Self { image, access, reach, is_before: false, eye, is_optional: false, is_cleared: false, name, element }
    }

    pub fn read(image: impl Into<Image>) -> Self {
        Self::new(image, Access::Read)
    }

    pub fn write(image: impl Into<Image>) -> Self {
        Self::new(image, Access::Write)
    }

    pub fn write_then_read(image: impl Into<Image>) -> Self {
        Self::new(image, Access::WriteThenRead)
    }

    pub fn update(image: impl Into<Image>) -> Self {
        Self::new(image, Access::Update)
    }

    pub fn add(image: impl Into<Image>) -> Self {
        Self::new(image, Access::Add)
    }

    /// Reads this many rows above and below as well.
    pub fn halo(self, rows: u32) -> Self {
        self.reaching(Reach::Halo(rows))
    }

    pub fn reaching(self, reach: Reach) -> Self {
        Self { reach, ..self }
    }

    /// Binds the image of the previous frame, and reads this many rows above and below as well. `None` means that there
    /// is no previous frame: the image is bound but not read.
    pub fn before(self, rows: Option<u32>) -> Self {
        Self { is_before: true, is_optional: rows.is_none(), ..self.halo(rows.unwrap_or(0)) }
    }

    /// Binds the image of this eye, whichever view the pass has.
    pub fn of(self, eye: Eye) -> Self {
        Self { eye: Some(eye), ..self }
    }

    pub fn if_written(self) -> Self {
        Self { is_optional: true, ..self }
    }

    pub fn cleared(self) -> Self {
        Self { is_cleared: true, ..self }
    }

    /// Sets the name of the shader's variable. The default is the name that `Resource::bound_as` sets, or else that of
    /// the resource, for example `hit`. For an image of the previous frame it is `last_hit`, and for that of a given
    /// eye in either frame it is `left_hit` if the eye is a source, and else `right_hit`.
    pub fn named(self, name: &'static str) -> Self {
        Self { name: Some(name), ..self }
    }

    /// Sets the type of the elements that the shader sees. Each texel consists of one or more of them.
    pub fn viewed_as<T: Texel>(self) -> Self {
        Self { element: Some(T::ELEMENT), ..self }
    }

    /// Returns true if the graph must bring the rows of the image to the device: the pass reads the image, and the host
    /// does not set it.
    pub fn is_read(&self) -> bool {
        self.access.reads() && self.image.resource.life != Life::Input
    }
}
