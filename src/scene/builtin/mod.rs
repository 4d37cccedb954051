//! Built-in scenes, for demos, measurements and tests without files.
//!
//! A built-in scene holds geometry, materials and motion. Its default shot, in the repository's `scenes/`, adds camera,
//! environment and static lights. A static scene is a glTF file beside its shot, embedded in the program. It is compressed
//! by gzip: the PNG decoder needs a decompressor for it anyway, and every system has a tool for it. The animated
//! `studio` is code, because exports hold no motion. Both give the same bits every time on every machine.

mod studio;

#[cfg(test)]
mod tests;

use std::io::Read;
use std::path::PathBuf;

use flate2::read::GzDecoder;

use super::budget::Budget;
use super::folder::{Access, Files, Source};
use super::motion::play::Play;
use super::{Scene, SceneError, gltf};

/// A scene that comes with this crate.
#[derive(Clone, Copy, Debug)]
pub struct Builtin {
    pub name: &'static str,
    /// Description in one line.
    pub about: &'static str,
    /// TOML text of its default shot.
    pub shot: &'static str,
    content: Content,
}

#[derive(Clone, Copy, Debug)]
enum Content {
    /// A `.glb`, compressed by gzip.
    File(&'static [u8]),
    Code(fn() -> Scene),
}

/// Limit on the size of a decompressed file.
const MAX_BYTES: u64 = 16 << 20;

/// Returns a [`Builtin`] from its files in `scenes/`, or from its shot there and a function.
macro_rules! builtin {
    ($name:literal, $about:literal) => {
        builtin!($name, $about, Content::File(include_bytes!(concat!("../../../scenes/", $name, ".glb.gz"))))
    };
    ($name:literal, $about:literal, $content:expr) => {
        Builtin {
            name: $name,
            about: $about,
            shot: include_str!(concat!("../../../scenes/", $name, ".toml")),
            content: $content,
        }
    };
}

/// All built-in scenes, the demo scene first.
pub static BUILTINS: &[Builtin] = &[
    builtin!("atrium", "a two-storey colonnaded court in the sun, 260,000 triangles"),
    builtin!("forest", "a wood at night with 80 lanterns, 200,000 triangles with cut-out leaves"),
    builtin!("checker", "hard edges from 0.5 m to 50 m, for seams and reprojection"),
    builtin!("cornell", "the classic box with one area light, all Lambertian"),
    builtin!("furnace", "spheres of known albedo in an environment of radiance 1"),
    builtin!("gallery", "a room of mirrors, glass, water, polish and brushed metal, with a window"),
    builtin!(
        "studio",
        "a room in which a figure walks, lamps swing, a fan turns, a banner waves and a sign goes out",
        Content::Code(studio::build)
    ),
    builtin!("towers", "streets at night between 100 towers with 10,000 lit windows, each a light"),
];

/// Returns the built-in scene with this name.
pub fn find(name: &str) -> Result<&'static Builtin, SceneError> {
    BUILTINS.iter().find(|b| b.name == name).ok_or_else(|| SceneError::UnknownBuiltin {
        name: name.into(),
        known: BUILTINS.iter().map(|b| b.name).collect::<Vec<_>>().join(", "),
    })
}

impl Builtin {
    /// Returns the scene.
    pub fn build(&self) -> Scene {
        match self.content {
            Content::File(compressed) => read(self.name, compressed).expect("a test reads every embedded file"),
            Content::Code(build) => build(),
        }
    }
}

/// Reads a compressed `.glb`. The reader sees no other file, on disk or elsewhere.
fn read(name: &str, compressed: &[u8]) -> Result<Scene, SceneError> {
    let path = PathBuf::from(format!("{name}.glb"));
    let mut bytes = Vec::new();
    let inflated = GzDecoder::new(compressed).take(MAX_BYTES).read_to_end(&mut bytes);
    inflated.map_err(|source| SceneError::Read { path: path.display().to_string(), source })?;
    let files = Files::from([(path.clone(), bytes)]);
    let budget = Budget::unlimited();
    let access = Access { strict: true, source: Source::Sent(&files), ..Access::of(&budget) };
    gltf::load(&path, &Play::default(), None, access)
}
