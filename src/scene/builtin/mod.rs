//! Scenes made by this crate, so that there is always something to look at, measure and test with.
//!
//! A built-in scene holds geometry, materials and what moves; its default shot, in the repository's `scenes/`, adds
//! camera, environment and lights that stand still. Building one gives the same bits every time and everywhere.

mod assembly;
mod atrium;
mod checker;
mod cornell;
mod forest;
mod furnace;
mod geometry;
mod maths;
mod shapes;
mod studio;
mod texels;
mod towers;

#[cfg(test)]
mod tests;

use super::{Scene, SceneError};

/// A scene that needs no file.
#[derive(Clone, Copy, Debug)]
pub struct Builtin {
    pub name: &'static str,
    /// One line for people.
    pub about: &'static str,
    /// TOML text of its default shot.
    pub shot: &'static str,
    pub build: fn() -> Scene,
}

/// All of them, the demo scene first.
pub const BUILTINS: &[Builtin] = &[
    Builtin {
        name: "atrium",
        about: "a two-storey colonnaded court in the sun, 260,000 triangles",
        shot: include_str!("../../../scenes/atrium.toml"),
        build: atrium::build,
    },
    Builtin {
        name: "forest",
        about: "a wood at night with 80 lanterns, 200,000 triangles with cut-out leaves",
        shot: include_str!("../../../scenes/forest.toml"),
        build: forest::build,
    },
    Builtin {
        name: "checker",
        about: "hard edges from 0.5 m to 50 m, for seams and reprojection",
        shot: include_str!("../../../scenes/checker.toml"),
        build: checker::build,
    },
    Builtin {
        name: "cornell",
        about: "the classic box with one area light, all Lambertian",
        shot: include_str!("../../../scenes/cornell.toml"),
        build: cornell::build,
    },
    Builtin {
        name: "furnace",
        about: "spheres of known albedo in an environment of radiance 1",
        shot: include_str!("../../../scenes/furnace.toml"),
        build: furnace::build,
    },
    Builtin {
        name: "studio",
        about: "a room in which a figure walks, lamps swing, a fan turns, a banner waves and a sign goes out",
        shot: include_str!("../../../scenes/studio.toml"),
        build: studio::build,
    },
    Builtin {
        name: "towers",
        about: "streets at night between 100 towers with 10,000 lit windows, each a light",
        shot: include_str!("../../../scenes/towers.toml"),
        build: towers::build,
    },
];

/// The built-in scene of that name.
pub fn find(name: &str) -> Result<&'static Builtin, SceneError> {
    BUILTINS.iter().find(|b| b.name == name).ok_or_else(|| SceneError::UnknownBuiltin {
        name: name.into(),
        known: BUILTINS.iter().map(|b| b.name).collect::<Vec<_>>().join(", "),
    })
}
