//! Values of the views of a rig.

use std::collections::BTreeMap;

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

use crate::scene::rig::Eye;

/// A value for each view, from left to right. In files it is a map from the views' names.
#[derive(Clone, Debug, PartialEq)]
pub struct PerView<T>(Vec<T>);

impl<T> PerView<T> {
    /// Returns the values of the two eyes.
    pub fn both(left: T, right: T) -> Self {
        Self(vec![left, right])
    }

    /// Returns the value of a view.
    pub fn of(&self, eye: Eye) -> &T {
        &self.0[eye.index()]
    }

    /// Returns the value of the leftmost view, which is the left eye's if there are two.
    pub fn left(&self) -> &T {
        &self.0[0]
    }

    /// Returns the value of the rightmost view.
    pub fn right(&self) -> &T {
        &self.0[self.0.len() - 1]
    }

    /// Returns the values of the outermost views.
    pub fn outer(&self) -> [&T; 2] {
        [self.left(), self.right()]
    }

    /// Returns the values of the views, from left to right.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &T> {
        self.0.iter()
    }

    pub fn iter_mut(&mut self) -> impl ExactSizeIterator<Item = &mut T> {
        self.0.iter_mut()
    }

    /// Returns the views with their values.
    pub fn with_eyes(&self) -> impl Iterator<Item = (Eye, &T)> {
        Eye::of_rig(self.0.len()).zip(&self.0)
    }

    /// Returns the views with their values.
    pub fn with_eyes_mut(&mut self) -> impl Iterator<Item = (Eye, &mut T)> {
        Eye::of_rig(self.0.len()).zip(&mut self.0)
    }

    /// Returns what `of` returns for each value.
    pub fn map<U>(self, of: impl FnMut(T) -> U) -> PerView<U> {
        PerView(self.0.into_iter().map(of).collect())
    }

    /// Returns the values, from left to right.
    pub fn values(&self) -> &[T] {
        &self.0
    }

    /// Returns the value of the leftmost view.
    pub fn into_left(self) -> T {
        self.0.into_iter().next().expect("a rig has at least one view")
    }
}

impl<T: Clone> PerView<T> {
    /// Returns the values of the outermost views.
    pub fn into_outer(self) -> [T; 2] {
        self.outer().map(T::clone)
    }
}

impl<T> IntoIterator for PerView<T> {
    type Item = T;
    type IntoIter = std::vec::IntoIter<T>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

/// Collects the values of the views, of which there is at least one, from left to right.
impl<T> FromIterator<T> for PerView<T> {
    fn from_iter<I: IntoIterator<Item = T>>(values: I) -> Self {
        Self(values.into_iter().collect())
    }
}

impl<T: Serialize> Serialize for PerView<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.with_eyes())
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for PerView<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let values = BTreeMap::<Eye, T>::deserialize(deserializer)?;
        if values.is_empty() || !Eye::of_rig(values.len()).eq(values.keys().copied()) {
            return Err(de::Error::custom("not a value for each view"));
        }
        Ok(Self(values.into_values().collect()))
    }
}

#[cfg(feature = "schema")]
impl<T: schemars::JsonSchema> schemars::JsonSchema for PerView<T> {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        format!("PerView_for_{}", T::schema_name()).into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        let of_view = generator.subschema_for::<T>();
        schemars::json_schema!({ "type": "object", "additionalProperties": of_view })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_stored_by_view() {
        let round_trip = |values: &PerView<u8>, text: &str| {
            assert_eq!(serde_json::to_string(values).unwrap(), text);
            assert_eq!(serde_json::from_str::<PerView<u8>>(text).unwrap(), *values);
        };
        round_trip(&PerView::both(3, 4), r#"{"left":3,"right":4}"#);
        let row: PerView<u8> = (0..3).collect();
        round_trip(&row, r#"{"view00 of 3":0,"view01 of 3":1,"view02 of 3":2}"#);
        assert_eq!((row.outer(), *row.of(Eye::of_rig(3).nth(1).unwrap())), ([&0, &2], 1));
        for text in ["{}", r#"{"left":3}"#, r#"{"left":3,"view01 of 3":1}"#, r#"{"view00 of 3":0}"#] {
            assert!(serde_json::from_str::<PerView<u8>>(text).is_err(), "{text}");
        }
    }
}
