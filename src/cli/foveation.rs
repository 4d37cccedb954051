//! Options of foveation.

use std::str::FromStr;
use std::sync::LazyLock;

use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};

use crate::frame::Foveation;
use crate::quality::{Denoiser, Filter, LogPolar, PolarSpace, Quality};
use crate::scene::shot::Gaze;

use super::denoisers::DenoiserChoice;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum FoveationMode {
    #[default]
    None,
    Layers,
    /// A polar projection; other options may change its parameters.
    Polar(PolarSpace),
}

impl ValueEnum for FoveationMode {
    fn value_variants<'a>() -> &'a [Self] {
        static ALL: LazyLock<Vec<FoveationMode>> = LazyLock::new(|| {
            let polar = PolarSpace::ALL.iter().map(|space| FoveationMode::Polar(*space));
            [FoveationMode::None, FoveationMode::Layers].into_iter().chain(polar).collect()
        });
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let (name, help) = match self {
            Self::None => ("none", "The same quality everywhere"),
            Self::Layers => ("layers", "Three layers: fewer samples and more filtering away from the gaze"),
            Self::Polar(space) => (space.method().name(), space.method().help()),
        };
        Some(PossibleValue::new(name).help(help))
    }
}

impl FoveationMode {
    /// Returns the default radii of the inner and the middle foveal layer, as fractions of the image width; `None`
    /// without layers.
    pub fn radii(self) -> Option<[f64; 2]> {
        (self == Self::Layers).then_some(Foveation::RADII)
    }

    /// Returns the polar space that replaces the screen's pixel grid, if any. `map` is the mapping of log-polar space.
    pub fn space(self, map: Option<LogPolar>) -> Option<PolarSpace> {
        match (self, map) {
            (Self::None | Self::Layers, _) => None,
            (Self::Polar(PolarSpace::Log(_)), Some(map)) => Some(PolarSpace::Log(map)),
            (Self::Polar(space), _) => Some(space),
        }
    }

    pub fn is_log_polar(self) -> bool {
        matches!(self, Self::Polar(PolarSpace::Log(_)))
    }
}

#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = super::headings::QUALITY)]
pub struct FoveationFlags {
    /// Foveated rendering
    #[arg(long, default_value = "none")]
    pub foveation: FoveationMode,
    /// Gaze as fractions of the image, X,Y or LX,LY,RX,RY [default: the shot's]
    #[arg(long, value_name = "X,Y")]
    pub gaze: Option<GazeOption>,
    /// Log-polar mode, e.g. fov, or SIGMA,ALPHA,GAZE,ASPECT [default: composite mode]
    ///
    /// Modes are fov, kernel, composite and composite-kernel. SIGMA: downsampling factor; ALPHA: kernel exponent; GAZE:
    /// full-resolution radius, radians; ASPECT: rings / directions.
    #[arg(hide_short_help = true, long, value_name = "MODE")]
    pub polar: Option<LogPolar>,
    /// Denoiser iterations, also per layer as M,N,P [default: 5; 2,3,5 with layers]
    #[arg(long, value_name = "M[,N,P]", value_parser = iterations)]
    pub iterations: Option<[u32; 3]>,
}

impl FoveationFlags {
    /// True if frames have foveal layers.
    pub fn is_on(&self) -> bool {
        self.foveation == FoveationMode::Layers
    }

    /// Returns the polar space that replaces the screen's pixel grid, if any.
    pub fn space(&self) -> Option<PolarSpace> {
        self.foveation.space(self.polar)
    }

    /// Returns the iterations of the inner, middle and outer layer.
    pub fn layer_iterations(&self) -> [u32; 3] {
        self.iterations.unwrap_or(if self.is_on() { LAYER_ITERATIONS } else { [Denoiser::DEFAULT_ITERATIONS; 3] })
    }

    /// Caps the iterations of a quality: in foveal layers at those of the flags or else of Peres ([`LAYER_ITERATIONS`]).
    /// Without layers, the largest of the flags' caps applies to the whole image.
    pub fn limit(&self, quality: &Quality) -> Quality {
        let limits = match (quality.fovea, self.iterations) {
            (Some(_), layers) => layers.unwrap_or(LAYER_ITERATIONS),
            (None, Some([inner, middle, outer])) => [inner.max(middle).max(outer); 3],
            (None, None) => return *quality,
        };
        let iterations = limits.map(|limit| limit.min(quality.most_iterations()));
        Quality { filter: Filter::in_effect(quality.denoiser(), iterations), ..*quality }
    }

    /// Returns the gaze of each eye that `--gaze` sets in place of the shot's.
    pub fn gaze(&self) -> Option<[Gaze; 2]> {
        self.gaze.map(|GazeOption(eyes)| eyes.map(|[x, y]| Gaze { path: vec![[0.0, x, y]] }))
    }

    /// Checks constraints that clap cannot express.
    pub fn check(&self, denoiser: DenoiserChoice) -> Result<(), anyhow::Error> {
        let is_on = self.is_on();
        anyhow::ensure!(
            denoiser.is_some() || self.iterations.is_none_or(|layers| layers == [0; 3]),
            "--iterations needs a denoiser: leave it out, or choose another --denoiser than none"
        );
        if let (Some(denoiser), Some(layers)) = (denoiser, self.iterations) {
            let (most, name) = (denoiser.most_iterations(), Denoiser::name_of(Some(denoiser)));
            anyhow::ensure!(
                layers.iter().all(|n| *n <= most),
                "--iterations: --denoiser {name} takes at most {most}: give fewer, or choose another denoiser"
            );
        }
        anyhow::ensure!(
            self.foveation != FoveationMode::None || self.gaze.is_none(),
            "--gaze needs foveation: add, for example, --foveation layers"
        );
        anyhow::ensure!(self.foveation.is_log_polar() || self.polar.is_none(), "--polar needs --foveation log-polar");
        anyhow::ensure!(
            is_on || self.iterations.is_none_or(|[inner, middle, outer]| inner == middle && middle == outer),
            "--iterations M,N,P needs --foveation layers: give one number without it"
        );
        Ok(())
    }
}

/// Iterations of the inner, middle and outer layer in the three-layer configuration of Peres, section 6.
const LAYER_ITERATIONS: [u32; 3] = [2, 3, 5];

/// Gaze of the left and the right eye, as fractions of the image from the top left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GazeOption([[f64; 2]; 2]);

impl FromStr for GazeOption {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match numbers(text, |n: &f64| (0.0..=1.0).contains(n)).as_deref() {
            Some(&[x, y]) => Ok(Self([[x, y]; 2])),
            Some(&[lx, ly, rx, ry]) => Ok(Self([[lx, ly], [rx, ry]])),
            _ => Err("give two or four numbers from 0 to 1".to_owned()),
        }
    }
}

fn iterations(text: &str) -> Result<[u32; 3], String> {
    match numbers(text, |n: &u32| *n <= Denoiser::MAX_ITERATIONS).as_deref() {
        Some(&[all]) => Ok([all; 3]),
        Some(&[inner, middle, outer]) => Ok([inner, middle, outer]),
        _ => Err(format!("give one or three numbers from 0 to {}", Denoiser::MAX_ITERATIONS)),
    }
}

fn numbers<T: FromStr>(text: &str, is_allowed: fn(&T) -> bool) -> Option<Vec<T>> {
    text.split(',').map(|n| n.trim().parse().ok().filter(is_allowed)).collect()
}

/// The configurations of Peres, section 6.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// No foveation: 4 samples, 5 iterations
    Base,
    /// Foveated, two denoising layers of 3 and 5 iterations
    Nh2ld,
    /// Foveated, three denoising layers of 2, 3 and 5 iterations
    Nh3ld,
}

impl Preset {
    /// Samples of each sampled pixel; foveation leaves some pixels unsampled.
    pub const SPP: u32 = 4;

    /// Returns the foveation mode, and the iterations of the inner, middle and outer layer.
    pub fn layers(self) -> (FoveationMode, [u32; 3]) {
        match self {
            Self::Base => (FoveationMode::None, [Denoiser::DEFAULT_ITERATIONS; 3]),
            Self::Nh2ld => (FoveationMode::Layers, [3, 5, 5]),
            Self::Nh3ld => (FoveationMode::Layers, LAYER_ITERATIONS),
        }
    }
}
