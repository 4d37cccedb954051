//! The options of foveation.

use std::str::FromStr;

use clap::{Args, ValueEnum};

use diptych::quality::Denoiser;
use diptych::scene::shot::Gaze;
use diptych::stages::Foveation;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FoveationMode {
    /// Every pixel alike
    None,
    /// Three layers around the gaze, fewer samples and more filtering outwards
    Layers,
}

#[derive(Args, Clone, Debug)]
#[command(next_help_heading = super::options::QUALITY)]
pub struct FoveationOptions {
    /// What follows the gaze
    #[arg(long, default_value = "none")]
    pub foveation: FoveationMode,
    /// Where both eyes look, fractions of an eye's image from the top left, or each one: X,Y or LX,LY,RX,RY [default: the
    /// shot's gaze]
    #[arg(long, value_name = "X,Y")]
    pub gaze: Option<GazeOption>,
    /// Iterations of the denoiser; with layers of the inner, middle and outer one [default: 5; 2,3,5 with layers]
    #[arg(long, value_name = "M[,N,P]")]
    pub iterations: Option<Iterations>,
}

impl FoveationOptions {
    /// Every pixel alike, with this many iterations.
    pub fn none(iterations: u32) -> Self {
        Self { foveation: FoveationMode::None, gaze: None, iterations: Some(Iterations::All(iterations)) }
    }

    /// Layers with at most this many iterations.
    pub fn layers(iterations: u32) -> Self {
        let layers = LAYER_ITERATIONS.map(|most| most.min(iterations));
        Self { foveation: FoveationMode::Layers, gaze: None, iterations: Some(Iterations::Layers(layers)) }
    }

    pub fn is_on(&self) -> bool {
        self.foveation == FoveationMode::Layers
    }

    /// Iterations of the inner, middle and outer layer.
    pub fn layer_iterations(&self) -> [u32; 3] {
        match (&self.iterations, self.foveation) {
            (Some(Iterations::All(all)), _) => [*all; 3],
            (Some(Iterations::Layers(layers)), _) => *layers,
            (None, FoveationMode::None) => [Denoiser::DEFAULT_ITERATIONS; 3],
            (None, FoveationMode::Layers) => LAYER_ITERATIONS,
        }
    }

    /// Foveation with these iterations, if it is asked for.
    pub fn of(&self, shot: &Gaze, iterations: [u32; 3]) -> Option<Foveation> {
        let gaze = match self.gaze {
            None => [shot.clone(), shot.clone()],
            Some(GazeOption(eyes)) => eyes.map(|[x, y]| Gaze { path: vec![[0.0, x, y]] }),
        };
        self.is_on().then(|| Foveation::new(gaze, iterations))
    }

    /// What clap cannot see.
    pub fn check(&self) -> Result<(), anyhow::Error> {
        let is_on = self.is_on();
        anyhow::ensure!(is_on || self.gaze.is_none(), "--gaze is for --foveation layers");
        anyhow::ensure!(
            is_on || !matches!(self.iterations, Some(Iterations::Layers(_))),
            "--iterations M,N,P is for --foveation layers: give one number"
        );
        Ok(())
    }
}

/// Of Peres, section 6: the configuration with three layers.
const LAYER_ITERATIONS: [u32; 3] = [2, 3, 5];

/// Where the eyes look.
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

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Iterations {
    All(u32),
    Layers([u32; 3]),
}

impl FromStr for Iterations {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match numbers(text, |n: &u32| *n <= Denoiser::MAX_ITERATIONS).as_deref() {
            Some(&[all]) => Ok(Self::All(all)),
            Some(&[inner, middle, outer]) => Ok(Self::Layers([inner, middle, outer])),
            _ => Err(format!("give one or three numbers from 0 to {}", Denoiser::MAX_ITERATIONS)),
        }
    }
}

fn numbers<T: FromStr>(text: &str, is_allowed: fn(&T) -> bool) -> Option<Vec<T>> {
    text.split(',').map(|n| n.trim().parse().ok().filter(is_allowed)).collect()
}

/// The configurations of Peres, section 6.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// Every pixel alike: 4 samples, 5 iterations
    Base,
    /// Foveated, denoised in two layers of 3 and 5 iterations
    Nh2ld,
    /// Foveated, denoised in three layers of 2, 3 and 5 iterations
    Nh3ld,
}

impl Preset {
    pub const SPP: u32 = 4;

    pub fn foveation(self) -> FoveationMode {
        if self == Self::Base { FoveationMode::None } else { FoveationMode::Layers }
    }

    pub fn iterations(self) -> Iterations {
        match self {
            Self::Base => Iterations::All(5),
            Self::Nh2ld => Iterations::Layers([3, 5, 5]),
            Self::Nh3ld => Iterations::Layers(LAYER_ITERATIONS),
        }
    }
}
