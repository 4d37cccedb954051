//! A subject of a study under its conditions.

use diptych::loaded::LoadedScene;

use super::args::StudyArgs;
use super::definition::Study;
use super::locked::Conditions;
use super::subject::Subject;
use crate::setup::Tracing;

/// A subject that is measured under some conditions.
pub struct Measuring<'a> {
    pub study: &'static Study,
    pub args: &'a StudyArgs,
    pub subject: &'a Subject,
    pub conditions: &'a Conditions,
    pub loaded: &'a LoadedScene,
    pub tracing: &'a Tracing,
}
