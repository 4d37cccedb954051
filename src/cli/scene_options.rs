//! Options that override a shot, and options for the files that it may name.

use std::path::PathBuf;

use clap::Args;
use etcetera::BaseStrategy;
use glam::{DVec3, Vec3};
use sysinfo::{MemoryRefreshKind, RefreshKind, System};

use crate::accel::TreeCache;
use crate::image::tone::ToneCurve;
use crate::scene::budget::{Budget, ByteSize};
use crate::scene::complete::{Look, Overrides};
use crate::scene::folder::{Access, Source};
use crate::scene::load::load_shot_within;
use crate::scene::motion::play::Choice;
use crate::scene::shot::allowed::{ANY, Allowed, NOT_NEGATIVE, STOPS, YFOV};
use crate::scene::shot::{Exposure, Shot, ShotEnvironment, Sky};
use crate::scene::viewpoint::Orbit;
use crate::scene::{Scene, SceneError};

#[derive(Args, Clone, Debug)]
#[command(next_help_heading = super::headings::SCENE)]
pub struct SceneOptions {
    /// Position of the eyes, scene units [default: the camera]
    ///
    /// Without a camera in the shot or the scene file, diptych chooses a viewpoint.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub position: Option<DVec3>,
    /// Point that the eyes look at, scene units
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub target: Option<DVec3>,
    /// Camera of the scene file, from 0 [default: the first one]
    #[arg(hide_short_help = true, long, value_name = "N")]
    pub camera: Option<usize>,
    /// Vertical field of view, degrees [default: the camera's]
    #[arg(long, value_name = "DEG", value_parser = |text: &str| number(text, &YFOV))]
    pub yfov: Option<f64>,
    /// Interpupillary distance, metres [default: the shot's, else 0.064]
    #[arg(hide_short_help = true, long, value_name = "M", value_parser = |text: &str| number(text, &NOT_NEGATIVE))]
    pub baseline: Option<f64>,
    /// View of the whole scene from outside, instead of a camera
    #[arg(hide_short_help = true, long, conflicts_with_all = ["position", "target", "camera"])]
    pub view: Option<View>,
    /// View from this azimuth and elevation, degrees, and zoom, such as 30,20,1
    ///
    /// Azimuth 0 is the front, +z, and 90 the side at +x. Elevation 90 is above. Zoom 1 shows the whole scene; 2 shows
    /// it twice as large.
    #[arg(hide_short_help = true, long, value_name = "AZ,EL[,ZOOM]", value_parser = orbit, allow_hyphen_values = true, conflicts_with_all = ["view", "position", "target", "camera"])]
    pub orbit: Option<Orbit>,
    /// Exposure of pictures in stops, or auto; EXR files are not exposed
    ///
    /// auto meters a small frame before the run and prints the result. The default is the exposure of the shot, and
    /// auto for a glTF file. `scale` and `bench` use 0 instead of auto.
    #[arg(long, value_name = "EV|auto", value_parser = exposure, allow_hyphen_values = true)]
    pub exposure: Option<Exposure>,
    /// Tone curve of pictures [default: neutral for a glTF file, reinhard for a shot]
    ///
    /// Image metrics such as FLIP always use reinhard.
    #[arg(hide_short_help = true, long, value_name = "CURVE")]
    pub tonemap: Option<ToneCurve>,
    /// Environment: studio, white, sky, an .hdr or .exr file, or a radiance R,G,B
    ///
    /// The default is the shot's. A glTF file without lights gets the studio: soft boxes, and a ground below an object.
    /// white is a radiance of 1 from all directions, which `export` and `shot` use instead of the studio.
    #[arg(hide_short_help = true, long, value_name = "NAME|FILE|R,G,B", value_parser = environment)]
    pub environment: Option<ShotEnvironment>,
    /// Animations to play: all, none, or a name [default: the shot's, else all]
    #[arg(hide_short_help = true, long, value_name = "NAME", value_parser = animation)]
    pub animation: Option<Choice>,
    /// Material variant of the scene file, by its name [default: its default look]
    #[arg(hide_short_help = true, long, value_name = "NAME")]
    pub variant: Option<String>,
    /// Maximum host memory for the scene, such as 4GiB [default: half the RAM]
    #[arg(hide_short_help = true, long, value_name = "SIZE")]
    pub max_scene_memory: Option<ByteSize>,
    /// Folder that keeps the trees of large scenes for later runs, or off
    ///
    /// Trees that take over a second to build are kept, up to 4 GiB in all. The default is diptych in the user's folder
    /// of caches.
    #[arg(hide_short_help = true, long, value_name = "DIR|off")]
    pub scene_cache: Option<PathBuf>,
    /// Allow shots and scenes to name files outside their folders
    #[arg(hide_short_help = true, long)]
    pub allow_outside: bool,
    /// Refuse scenes with faulty textures or animations, instead of a warning
    #[arg(hide_short_help = true, long)]
    pub strict: bool,
}

impl SceneOptions {
    pub fn budget(&self) -> Budget {
        Budget::new(self.max_scene_memory.unwrap_or_else(|| ByteSize(host_memory() / 2)))
    }

    /// Returns the cache of trees. There is none without a folder for caches.
    pub fn tree_cache(&self) -> TreeCache {
        let usual = || etcetera::choose_base_strategy().ok().map(|base| base.cache_dir().join("diptych"));
        match &self.scene_cache {
            Some(folder) if folder.as_os_str() == "off" => TreeCache::off(),
            Some(folder) => TreeCache::in_folder(folder.clone()),
            None => usual().map_or_else(TreeCache::off, TreeCache::in_folder),
        }
    }

    /// Loads a shot and its scene. The path of an animated camera begins at `time_s`.
    pub fn load(&self, shot: &str, time_s: f64, budget: &Budget) -> Result<(Shot, Scene), SceneError> {
        self.load_from(Source::Disk, Look::Plain, shot, time_s, budget)
    }

    /// Loads a shot and its scene from another source of files.
    pub fn load_from(
        &self,
        source: Source,
        look: Look,
        shot: &str,
        time_s: f64,
        budget: &Budget,
    ) -> Result<(Shot, Scene), SceneError> {
        let overrides = Overrides {
            yfov_rad: self.yfov.map(f64::to_radians),
            baseline_m: self.baseline,
            exposure: self.exposure,
            orbit: self.orbit.or(self.view.map(View::orbit)),
            camera: self.camera,
            position: self.position,
            target: self.target,
            environment: self.environment.clone(),
            look,
            tone: self.tonemap,
            animation: self.animation.clone(),
            variant: self.variant.clone(),
            time_s,
        };
        load_shot_within(
            shot,
            &overrides,
            Access { budget, allow_outside: self.allow_outside, strict: self.strict, source },
        )
    }
}

/// Returns the memory of this machine, or of the container if that has less, in bytes.
fn host_memory() -> u64 {
    /// Default if the system reports none, in bytes.
    const UNKNOWN: u64 = 8 << 30;
    let ram = RefreshKind::nothing().with_memory(MemoryRefreshKind::nothing().with_ram());
    let system = System::new_with_specifics(ram);
    let container = system.cgroup_limits().map_or(u64::MAX, |limits| limits.total_memory);
    match system.total_memory().min(container) {
        0 => UNKNOWN,
        bytes => bytes,
    }
}

fn number(text: &str, allowed: &Allowed) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|number| allowed.allows(*number));
    number.ok_or_else(|| format!("give {}", allowed.what))
}

fn triple(text: &str, allowed: &Allowed) -> Option<DVec3> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| number(part, allowed).ok()).collect();
    <[f64; 3]>::try_from(numbers?).ok().map(DVec3::from)
}

fn point(text: &str) -> Result<DVec3, String> {
    triple(text, &ANY).ok_or_else(|| "give three numbers, e.g. 0,1.6,-2.5".to_owned())
}

fn exposure(text: &str) -> Result<Exposure, String> {
    if text == "auto" {
        return Ok(Exposure::Auto);
    }
    number(text, &STOPS).map(|ev| Exposure::Ev(ev as f32)).map_err(|what| format!("{what}, or auto"))
}

fn orbit(text: &str) -> Result<Orbit, String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let (azimuth_deg, elevation_deg, zoom) = match numbers.as_deref() {
        Some([azimuth, elevation]) => (*azimuth, *elevation, 1.0),
        Some([azimuth, elevation, zoom]) => (*azimuth, *elevation, *zoom),
        _ => (f32::NAN, 0.0, 1.0),
    };
    let is_valid = azimuth_deg.is_finite() && (-90.0..=90.0).contains(&elevation_deg) && (0.01..=100.0).contains(&zoom);
    let what = "give azimuth, elevation (-90 to 90) and zoom (0.01 to 100), e.g. 30,20,1";
    if is_valid { Ok(Orbit { azimuth_deg, elevation_deg, zoom }) } else { Err(what.to_owned()) }
}

/// View of the whole scene from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum View {
    /// From the front, slightly above the horizon
    Front,
    /// From the front, right and above
    ThreeQuarter,
    /// From above
    Top,
}

impl View {
    fn orbit(self) -> Orbit {
        match self {
            Self::Front => Orbit::FRONT,
            Self::ThreeQuarter => Orbit::THREE_QUARTER,
            Self::Top => Orbit::TOP,
        }
    }
}

fn animation(text: &str) -> Result<Choice, String> {
    Ok(Choice::of(text))
}

fn environment(text: &str) -> Result<ShotEnvironment, String> {
    let lower = text.to_ascii_lowercase();
    let sky = match triple(text, &NOT_NEGATIVE) {
        Some(radiance) => Sky::Constant(radiance.as_vec3()),
        None if lower.ends_with(".hdr") || lower.ends_with(".exr") => Sky::Image(text.to_owned()),
        None if lower == "white" => Sky::Constant(Vec3::ONE),
        None => Sky::built_in(&lower).ok_or_else(|| {
            "give studio, white, sky, an .hdr or .exr file, or a radiance of three numbers ≥ 0, e.g. 1,1,1".to_owned()
        })?,
    };
    Ok(sky.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn environments_are_files_or_radiances() {
        let sky = |text| environment(text).map(|e| e.sky);
        assert_eq!(sky("1, 0,2.5"), Ok(Sky::Constant(glam::vec3(1.0, 0.0, 2.5))));
        assert_eq!(sky("white"), Ok(Sky::Constant(Vec3::ONE)));
        assert_eq!((sky("studio"), sky("sky")), (Ok(Sky::Studio), Ok(Sky::Clear)));
        assert_eq!(sky("skies/Dusk.HDR"), Ok(Sky::Image("skies/Dusk.HDR".into())));
        for wrong in ["", "1", "1,2", "1,2,-3", "1,2,nan", "1,2,1e39", "sky.png"] {
            assert!(sky(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn an_orbit_is_two_angles_and_perhaps_a_zoom() {
        let expected = Orbit { azimuth_deg: -30.0, elevation_deg: 20.0, zoom: 1.0 };
        assert_eq!((orbit("-30,20"), orbit("-30, 20, 2")), (Ok(expected), Ok(Orbit { zoom: 2.0, ..expected })));
        for wrong in ["", "1", "1,91", "1,2,0", "nan,0", "1,2,3,4"] {
            assert!(orbit(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn an_exposure_is_a_number_of_stops_or_auto() {
        assert_eq!((exposure("-1.5"), exposure("auto")), (Ok(Exposure::Ev(-1.5)), Ok(Exposure::Auto)));
        assert!(exposure("25").unwrap_err().contains("-24 to 24"));
    }

    #[test]
    fn the_host_has_memory() {
        assert!((1 << 27..1 << 51).contains(&host_memory()), "{}", host_memory());
    }

    #[test]
    fn points_are_three_finite_numbers() {
        assert_eq!(point("-1,0.5,2"), Ok(DVec3::new(-1.0, 0.5, 2.0)));
        for wrong in ["", "1,2", "1,2,3,4", "1,2,inf", "a,b,c"] {
            assert!(point(wrong).is_err(), "{wrong}");
        }
    }
}
