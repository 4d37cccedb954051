//! Input from controllers and eye trackers, and its bindings.

use glam::DVec3;
use openxr::{Action, ActionSet, Binding, Instance, Path, Posef, Session, Space, Time, Vector2f, Vulkan};

use super::error::{HeadsetError, OpenXrResult};
use super::pose::head_pose;
use crate::scene::head::HeadPose;

/// Controller input since the previous frame, and the gaze.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Input {
    /// Thumbstick deflection to the right and ahead, each −1 to 1.
    pub stick: [f64; 2],
    pub recentres: bool,
    pub toggles_panel: bool,
    /// Gaze direction in the axes of the head, if a tracker reports one.
    pub gaze: Option<DVec3>,
}

/// Action that an input path below `/user` is bound to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum To {
    Move,
    Recentre,
    Panel,
    Gaze,
}

/// Suggested bindings of each interaction profile. Runtimes remap other controllers to these profiles.
const PROFILES: [(&str, &[(To, &str)]); 5] = [
    (
        "/interaction_profiles/khr/simple_controller",
        &[
            (To::Recentre, "hand/left/input/menu/click"),
            (To::Recentre, "hand/right/input/menu/click"),
            (To::Panel, "hand/left/input/select/click"),
            (To::Panel, "hand/right/input/select/click"),
        ],
    ),
    (
        "/interaction_profiles/oculus/touch_controller",
        &[
            (To::Move, "hand/left/input/thumbstick"),
            (To::Move, "hand/right/input/thumbstick"),
            (To::Recentre, "hand/left/input/y/click"),
            (To::Recentre, "hand/right/input/b/click"),
            (To::Panel, "hand/left/input/x/click"),
            (To::Panel, "hand/right/input/a/click"),
        ],
    ),
    (
        "/interaction_profiles/valve/index_controller",
        &[
            (To::Move, "hand/left/input/thumbstick"),
            (To::Move, "hand/right/input/thumbstick"),
            (To::Recentre, "hand/left/input/b/click"),
            (To::Recentre, "hand/right/input/b/click"),
            (To::Panel, "hand/left/input/a/click"),
            (To::Panel, "hand/right/input/a/click"),
        ],
    ),
    (
        "/interaction_profiles/microsoft/motion_controller",
        &[
            (To::Move, "hand/left/input/thumbstick"),
            (To::Move, "hand/right/input/thumbstick"),
            (To::Recentre, "hand/left/input/menu/click"),
            (To::Recentre, "hand/right/input/menu/click"),
            (To::Panel, "hand/left/input/trackpad/click"),
            (To::Panel, "hand/right/input/trackpad/click"),
        ],
    ),
    ("/interaction_profiles/ext/eye_gaze_interaction", &[(To::Gaze, "eyes_ext/input/gaze_ext/pose")]),
];

/// Actions of a session, bound to controllers and eye trackers.
pub struct Controls {
    set: ActionSet,
    moves: Action<Vector2f>,
    recentres: Action<bool>,
    toggles_panel: Action<bool>,
    /// Space of the gaze, if the runtime supports eye tracking.
    gaze: Option<Space>,
}

impl Controls {
    /// Creates the actions and suggests their bindings.
    ///
    /// # Errors
    /// Errors of the runtime. An unknown controller profile is not an error.
    pub fn new(xr: &Instance, session: &Session<Vulkan>, tracks_eyes: bool) -> Result<Self, HeadsetError> {
        let bind = "bind controllers";
        let set = xr.create_action_set("diptych", "diptych", 0).to(bind)?;
        let moves = set.create_action("move", "Move", &[]).to(bind)?;
        let recentres = set.create_action("recentre", "Recentre the view", &[]).to(bind)?;
        let toggles_panel = set.create_action("panel", "Show or hide frame times", &[]).to(bind)?;
        let looks = if tracks_eyes { Some(set.create_action::<Posef>("gaze", "Gaze", &[]).to(bind)?) } else { None };
        for (profile, bound) in PROFILES {
            let binding = |(to, path): &(To, &str)| {
                let path = xr.string_to_path(&format!("/user/{path}")).ok()?;
                match to {
                    To::Move => Some(Binding::new(&moves, path)),
                    To::Recentre => Some(Binding::new(&recentres, path)),
                    To::Panel => Some(Binding::new(&toggles_panel, path)),
                    To::Gaze => looks.as_ref().map(|looks| Binding::new(looks, path)),
                }
            };
            let bindings: Vec<Binding> = bound.iter().filter_map(binding).collect();
            if let (Ok(profile), false) = (xr.string_to_path(profile), bindings.is_empty()) {
                // Runtimes need not know every profile.
                let _ = xr.suggest_interaction_profile_bindings(profile, &bindings);
            }
        }
        session.attach_action_sets(&[&set]).to(bind)?;
        let gaze = looks.map(|looks| looks.create_space(session, Path::NULL, Posef::IDENTITY).to(bind)).transpose()?;
        Ok(Self { set, moves, recentres, toggles_panel, gaze })
    }

    /// Syncs the actions and returns their state. The gaze is predicted for the time `display` and relative to `head`,
    /// the space of the head.
    ///
    /// # Errors
    /// Errors of the runtime.
    pub fn read(&self, session: &Session<Vulkan>, head: &Space, display: Time) -> Result<Input, HeadsetError> {
        let read = "read the controllers' input";
        session.sync_actions(&[(&self.set).into()]).to(read)?;
        let stick = self.moves.state(session, Path::NULL).to(read)?;
        let [x, y] = if stick.is_active { [stick.current_state.x, stick.current_state.y] } else { [0.0; 2] };
        let is_pressed = |button: &Action<bool>| {
            let state = button.state(session, Path::NULL).to(read)?;
            Ok::<_, HeadsetError>(state.is_active && state.changed_since_last_sync && state.current_state)
        };
        let gaze = match &self.gaze {
            Some(gaze) => head_pose(&gaze.locate(head, display).to("locate the gaze")?.pose),
            None => None,
        };
        Ok(Input {
            stick: [x, y].map(f64::from),
            recentres: is_pressed(&self.recentres)?,
            toggles_panel: is_pressed(&self.toggles_panel)?,
            gaze: gaze.map(|HeadPose { orientation, .. }| orientation * DVec3::NEG_Z),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn either_hand_can_recentre_and_show_the_panel() {
        for (profile, bound) in PROFILES {
            let of = |to: To| bound.iter().filter(|(t, _)| *t == to).map(|(_, path)| *path).collect::<Vec<_>>();
            if !of(To::Gaze).is_empty() {
                continue;
            }
            for to in [To::Recentre, To::Panel] {
                for hand in ["hand/left/", "hand/right/"] {
                    assert_eq!(of(to).iter().filter(|path| path.starts_with(hand)).count(), 1, "{profile} {to:?}");
                }
            }
            let mut paths: Vec<&str> = bound.iter().map(|(_, path)| *path).collect();
            paths.sort_unstable();
            paths.dedup();
            assert_eq!(paths.len(), bound.len(), "{profile} has two actions on one button");
        }
    }
}
