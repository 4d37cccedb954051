//! The views of a rig: two eyes, or any number of cameras side by side.

use std::cmp::Ordering;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

/// A view of a rig, counted from the left. Two views are the eyes. A part of the views are sources, which are path traced
/// in every frame: other views may take over their light and their history.
///
/// Eyes compare equal if they have the same place among as many views.
#[derive(Clone, Copy)]
pub struct Eye {
    index: u8,
    views: u8,
    /// Number of sources, which is odd.
    sources: u8,
}

impl Eye {
    pub const LEFT: Eye = Eye { index: 0, views: 2, sources: 1 };
    pub const RIGHT: Eye = Eye { index: 1, views: 2, sources: 1 };
    /// The two eyes.
    pub const BOTH: [Eye; 2] = [Eye::LEFT, Eye::RIGHT];
    /// The largest number of views of a rig.
    pub const MOST_VIEWS: usize = 100;

    /// Returns the views of a rig that has this many, from left to right, with one source. There are at most
    /// [`Self::MOST_VIEWS`].
    pub fn of_rig(views: usize) -> impl DoubleEndedIterator<Item = Eye> + ExactSizeIterator + Clone {
        let views = views.clamp(1, Self::MOST_VIEWS) as u8;
        (0..views).map(move |index| Eye { index, views, sources: 1 })
    }

    /// Returns this view of a rig with so many sources, an odd number of at most that of its views.
    pub fn among(self, sources: usize) -> Eye {
        Eye { sources: sources.clamp(1, self.views.into()) as u8, ..self }
    }

    /// Returns the number of views to the left of this one.
    pub fn index(self) -> usize {
        self.index.into()
    }

    /// Returns the number of views of the rig.
    pub fn views(self) -> usize {
        self.views.into()
    }

    /// Returns the source in the middle, which also has what all views share: the left eye of two.
    pub fn main(self) -> Eye {
        Eye { index: (self.views - 1) / 2, ..self }
    }

    pub fn is_main(self) -> bool {
        self == self.main()
    }

    /// Returns the nearest source, which is the view itself if it is one.
    pub fn source(self) -> Eye {
        let [views, sources] = [self.views, self.sources].map(u32::from);
        // Each source stands in the middle of an equal part of the views.
        let places = (0..sources).map(|number| ((2 * number + 1) * views).div_ceil(2 * sources) - 1);
        let nearest = places.min_by_key(|place| place.abs_diff(self.index.into())).unwrap_or(0);
        Eye { index: nearest as u8, ..self }
    }

    pub fn is_source(self) -> bool {
        self == self.source()
    }

    /// Returns the second view whose light this one may take over: the next source on the other side of it from its own
    /// source or, beyond the outermost sources, the outermost view. `None` for sources and for that view.
    pub fn partner(self) -> Option<Eye> {
        let source = self.source();
        let beyond = |place: &Eye| place.index.abs_diff(source.index) > self.index.abs_diff(source.index);
        let is_beyond = |eye: &Eye| beyond(eye) && (*eye < source) == (self < source);
        let all = Eye::of_rig(self.views.into()).map(|eye| eye.among(self.sources.into()));
        let mut away: Vec<Eye> = all.filter(|eye| is_beyond(eye) && !self.is_source()).collect();
        away.sort_by_key(|eye| eye.index.abs_diff(source.index));
        away.iter().find(|eye| eye.is_source()).or(away.last()).copied()
    }

    /// Returns the view's offset from the middle of the rig to the right, in distances between neighbours.
    pub(super) fn offset(self) -> f64 {
        (f64::from(self.index) * 2.0 - f64::from(self.views - 1)) / 2.0
    }

    /// Returns the beginning of the names of the view's files: `left`, `right`, or `view07`.
    pub fn file_stem(self) -> String {
        match (self.views, self.index) {
            (2, 0) => "left".to_owned(),
            (2, _) => "right".to_owned(),
            (_, index) => format!("view{index:02}"),
        }
    }

    fn place(self) -> (u8, u8) {
        (self.index, self.views)
    }
}

impl PartialEq for Eye {
    fn eq(&self, other: &Self) -> bool {
        self.place() == other.place()
    }
}

impl Eq for Eye {}

impl PartialOrd for Eye {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Eye {
    fn cmp(&self, other: &Self) -> Ordering {
        self.place().cmp(&other.place())
    }
}

impl Hash for Eye {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.place().hash(state);
    }
}

impl fmt::Debug for Eye {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.views, self.index) {
            (2, 0) => f.write_str("Left"),
            (2, _) => f.write_str("Right"),
            _ => write!(f, "{self}"),
        }
    }
}

impl fmt::Display for Eye {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.file_stem())?;
        if self.views == 2 { Ok(()) } else { write!(f, " of {}", self.views) }
    }
}

/// Reads what [`Display`](fmt::Display) writes.
impl FromStr for Eye {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.strip_prefix("view").and_then(|rest| rest.split_once(" of "));
        let count = match numbers {
            None => 2,
            Some((_, views)) => views.parse().unwrap_or(0),
        };
        let known = Eye::of_rig(count).find(|eye| eye.to_string() == text);
        known.ok_or_else(|| format!("'{text}' is no view"))
    }
}

impl Serialize for Eye {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Eye {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(de::Error::custom)
    }
}

#[cfg(feature = "schema")]
impl schemars::JsonSchema for Eye {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Eye".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({ "type": "string", "pattern": "^(left|right|view[0-9]{2} of [0-9]+)$" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip() {
        let names: Vec<String> = Eye::of_rig(3).chain(Eye::BOTH).map(|eye| eye.to_string()).collect();
        assert_eq!(names, ["view00 of 3", "view01 of 3", "view02 of 3", "left", "right"]);
        for eye in Eye::of_rig(1).chain(Eye::of_rig(2)).chain(Eye::of_rig(100)) {
            assert_eq!(eye.to_string().parse(), Ok(eye));
        }
        for text in ["", "view01", "view03 of 3", "view00 of 2", "view1 of 3", "left of 2"] {
            assert!(text.parse::<Eye>().is_err(), "{text}");
        }
    }

    #[test]
    fn views_are_symmetric_about_their_middle() {
        for views in 1..=9 {
            let offsets: Vec<f64> = Eye::of_rig(views).map(Eye::offset).collect();
            assert!(offsets.windows(2).all(|pair| pair[1] - pair[0] == 1.0), "{offsets:?}");
            assert_eq!(offsets[0], -offsets[views - 1]);
            assert_eq!(Eye::of_rig(views).filter(|eye| eye.is_main()).count(), 1);
        }
        assert_eq!(Eye::LEFT.offset(), -0.5);
        assert_eq!((Eye::LEFT.source(), Eye::RIGHT.source()), (Eye::LEFT, Eye::LEFT));
        assert!(Eye::LEFT.is_main());
    }

    #[test]
    fn partners_lie_beyond_a_view_as_seen_from_its_source() {
        let partners = |views: usize, sources: usize| -> Vec<Option<usize>> {
            Eye::of_rig(views).map(|eye| eye.among(sources).partner().map(Eye::index)).collect()
        };
        assert_eq!(partners(2, 1), [None; 2]);
        assert_eq!(partners(3, 1), [None; 3]);
        assert_eq!(partners(6, 1), [None, Some(0), None, Some(5), Some(5), None]);
        // The sources are views 1, 4 and 7.
        let of_nine = [None, None, Some(4), Some(1), None, Some(7), Some(4), None, None];
        assert_eq!(partners(9, 3), of_nine);
    }

    #[test]
    fn sources_are_near_all_views_and_in_the_middle() {
        for views in 1..=48 {
            for sources in (1..=views).step_by(2) {
                let eyes: Vec<Eye> = Eye::of_rig(views).map(|eye| eye.among(sources)).collect();
                assert_eq!(eyes.iter().filter(|eye| eye.is_source()).count(), sources, "{views}");
                assert!(eyes[0].main().is_source());
                let farthest = eyes.iter().map(|eye| eye.index().abs_diff(eye.source().index())).max().unwrap();
                assert!(farthest <= views.div_ceil(sources).div_ceil(2), "{views} views, {sources}: {farthest}");
            }
        }
    }
}
