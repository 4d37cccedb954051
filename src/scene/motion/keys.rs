//! Keyframes and their interpolation (glTF 2.0, appendix C).

use glam::{DQuat, DVec4};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// Each key's value holds until the next key.
    Step,
    /// Linear interpolation; for rotations, spherical along the shortest path.
    Linear,
    /// Hermite splines. A key has an in-tangent, a value and an out-tangent; tangents are per second.
    CubicSpline,
}

/// Validated keys: at least one; finite, nonnegative, strictly increasing times; finite values, as many as keys and
/// interpolation require.
#[derive(Clone, Debug, PartialEq)]
pub struct Keys {
    times_s: Vec<f32>,
    values: Vec<f32>,
    width: usize,
    interpolation: Interpolation,
}

/// Fault in a list of keys.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum KeysError {
    #[error("there must be at least one key")]
    Empty,
    #[error("the time of key {0} is negative or not finite")]
    Time(usize),
    #[error("key {0} is not later than the previous key")]
    Order(usize),
    #[error("a value of key {0} is not finite")]
    Value(usize),
    #[error("{keys} keys have {values} numbers, not {expected}")]
    Count { keys: usize, values: usize, expected: usize },
}

/// Location of a time among keys.
enum Place {
    At(usize),
    /// Index of the key before, fraction of the interval to the next key, and the interval's length in seconds.
    Between(usize, f64, f64),
}

impl Keys {
    /// Validates keys. `values` has `width` numbers for each time, or three times as many for splines.
    ///
    /// # Errors
    /// [`KeysError`] that names the key.
    pub fn new(
        times_s: Vec<f32>,
        values: Vec<f32>,
        width: usize,
        interpolation: Interpolation,
    ) -> Result<Self, KeysError> {
        let parts = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
        let keys = times_s.len();
        let expected = keys.saturating_mul(width).saturating_mul(parts);
        if keys == 0 || width == 0 {
            return Err(KeysError::Empty);
        }
        if let Some(at) = times_s.iter().position(|t| !t.is_finite() || *t < 0.0) {
            return Err(KeysError::Time(at));
        }
        if let Some(at) = times_s.windows(2).position(|pair| pair[0] >= pair[1]) {
            return Err(KeysError::Order(at + 1));
        }
        if values.len() != expected {
            return Err(KeysError::Count { keys, values: values.len(), expected });
        }
        if let Some(at) = values.iter().position(|v| !v.is_finite()) {
            return Err(KeysError::Value(at / (width * parts)));
        }
        Ok(Self { times_s, values, width, interpolation })
    }

    /// Returns the time of the last key.
    pub fn end_s(&self) -> f64 {
        self.times_s.last().map_or(0.0, |t| f64::from(*t))
    }

    /// Returns the number of bytes on the heap.
    pub fn bytes(&self) -> u64 {
        ((self.times_s.capacity() + self.values.capacity()) * size_of::<f32>()) as u64
    }

    /// Returns the value's components at a time, clamped before the first key and after the last.
    pub fn at(&self, time_s: f64) -> Vec<f64> {
        let of = |key, part| self.part(key, part).iter().map(|v| f64::from(*v));
        match self.place(time_s) {
            Place::At(key) => of(key, VALUE).collect(),
            Place::Between(key, s, interval_s) => match self.interpolation {
                Interpolation::Step => of(key, VALUE).collect(),
                Interpolation::Linear => {
                    of(key, VALUE).zip(of(key + 1, VALUE)).map(|(a, b)| a * (1.0 - s) + b * s).collect()
                }
                Interpolation::CubicSpline => {
                    let values = of(key, VALUE).zip(of(key + 1, VALUE));
                    let tangents = of(key, OUT).zip(of(key + 1, IN));
                    values.zip(tangents).map(|((a, b), (out, into))| hermite(a, b, out, into, s, interval_s)).collect()
                }
            },
        }
    }

    /// Returns the rotation at a time as a unit quaternion. A zero quaternion counts as the identity.
    pub fn rotation_at(&self, time_s: f64) -> DQuat {
        match self.place(time_s) {
            Place::Between(key, s, _) if self.interpolation == Interpolation::Linear => {
                let [a, b] = [key, key + 1].map(|k| rotation(self.part(k, VALUE).iter().map(|v| f64::from(*v))));
                a.slerp(b, s).normalize()
            }
            _ => rotation(self.at(time_s).into_iter()),
        }
    }

    /// Returns true if every key's value is nonzero, so that it can be normalised to a unit quaternion.
    pub fn are_rotations(&self) -> bool {
        (0..self.times_s.len()).all(|key| self.part(key, VALUE).iter().any(|v| *v != 0.0))
    }

    fn place(&self, time_s: f64) -> Place {
        let last = self.times_s.len() - 1;
        let next = self.times_s.partition_point(|t| f64::from(*t) <= time_s);
        match next.checked_sub(1) {
            None => Place::At(0),
            Some(key) if key >= last => Place::At(last),
            Some(key) => {
                let [a, b] = [key, key + 1].map(|k| f64::from(self.times_s[k]));
                Place::Between(key, (time_s - a) / (b - a), b - a)
            }
        }
    }

    /// Returns a key's in-tangent, value or out-tangent. Only splines have tangents.
    fn part(&self, key: usize, part: usize) -> &[f32] {
        let start = match self.interpolation {
            Interpolation::CubicSpline => (3 * key + part) * self.width,
            _ => key * self.width,
        };
        &self.values[start..start + self.width]
    }
}

const IN: usize = 0;
const VALUE: usize = 1;
const OUT: usize = 2;

fn rotation(numbers: impl Iterator<Item = f64>) -> DQuat {
    let mut q = [0.0; 4];
    q.iter_mut().zip(numbers).for_each(|(to, from)| *to = from);
    DVec4::from_array(q).try_normalize().map_or(DQuat::IDENTITY, DQuat::from_vec4)
}

/// Interpolates from `a` to `b` over an interval of `interval_s` seconds, at the fraction `s` of the interval. `out` is
/// the tangent at `a`, and `into` the tangent at `b`.
fn hermite(a: f64, b: f64, out: f64, into: f64, s: f64, interval_s: f64) -> f64 {
    let (s2, s3) = (s * s, s * s * s);
    (2.0 * s3 - 3.0 * s2 + 1.0) * a
        + interval_s * (s3 - 2.0 * s2 + s) * out
        + (3.0 * s2 - 2.0 * s3) * b
        + interval_s * (s3 - s2) * into
}
