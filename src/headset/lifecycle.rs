//! Tracks the states of a session and derives the action that each requires.

use std::fmt;

use openxr::SessionState;

/// State of a session, named as in OpenXR's `XrSessionState`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// The headset is off or not worn.
    Idle,
    /// The session may begin.
    Ready,
    /// The runtime paces frames, but they are not visible.
    Synchronized,
    /// Frames are visible.
    Visible,
    /// Frames are visible and receive input.
    Focused,
    /// The session must end.
    Stopping,
    Exiting,
    LossPending,
}

impl State {
    /// Converts a state; returns `None` for states that later versions of OpenXR add.
    pub fn of(state: SessionState) -> Option<Self> {
        Some(match state {
            SessionState::IDLE => Self::Idle,
            SessionState::READY => Self::Ready,
            SessionState::SYNCHRONIZED => Self::Synchronized,
            SessionState::VISIBLE => Self::Visible,
            SessionState::FOCUSED => Self::Focused,
            SessionState::STOPPING => Self::Stopping,
            SessionState::EXITING => Self::Exiting,
            SessionState::LOSS_PENDING => Self::LossPending,
            _ => return None,
        })
    }
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Idle => "idle",
            Self::Ready => "ready",
            Self::Synchronized => "synchronized",
            Self::Visible => "visible",
            Self::Focused => "focused",
            Self::Stopping => "stopping",
            Self::Exiting => "exiting",
            Self::LossPending => "loss pending",
        })
    }
}

/// Action that a state change requires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    Nothing,
    Begin,
    End,
}

/// History of a session's states.
#[derive(Clone, Debug, Default)]
pub struct Lifecycle {
    /// States in order of time.
    states: Vec<State>,
    runs: bool,
}

/// Maximum number of states to remember: a headset may be put on and off all day.
const REMEMBERED: usize = 1000;

impl Lifecycle {
    /// Enters a new state and returns the action that it requires.
    pub fn enter(&mut self, state: State) -> Step {
        if self.has_ended() {
            return Step::Nothing;
        }
        if self.states.len() < REMEMBERED {
            self.states.push(state);
        } else if let Some(last) = self.states.last_mut() {
            *last = state;
        }
        match state {
            State::Ready if !self.runs => {
                self.runs = true;
                Step::Begin
            }
            State::Stopping if self.runs => {
                self.runs = false;
                Step::End
            }
            State::Exiting | State::LossPending => {
                self.runs = false;
                Step::Nothing
            }
            _ => Step::Nothing,
        }
    }

    /// Returns true if the session is running, so that the program must wait for frames, begin and end them.
    pub fn runs(&self) -> bool {
        self.runs
    }

    /// Returns the newest state.
    pub fn state(&self) -> Option<State> {
        self.states.last().copied()
    }

    /// Returns true if the session is over, so that no more frames follow.
    pub fn has_ended(&self) -> bool {
        matches!(self.state(), Some(State::Exiting | State::LossPending))
    }

    pub fn states(&self) -> &[State] {
        &self.states
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use State::{Exiting, Focused, Idle, LossPending, Ready, Stopping, Synchronized, Visible};

    fn steps(states: &[State]) -> (Vec<Step>, Lifecycle) {
        let mut lifecycle = Lifecycle::default();
        (states.iter().map(|state| lifecycle.enter(*state)).collect(), lifecycle)
    }

    #[test]
    fn session_begins_when_ready_and_ends_when_stopping() {
        let states = [Idle, Ready, Synchronized, Visible, Focused, Visible, Synchronized, Stopping, Idle, Exiting];
        let (steps, lifecycle) = steps(&states);
        let at = |step| steps.iter().position(|s| *s == step);
        assert_eq!((at(Step::Begin), at(Step::End)), (Some(1), Some(7)));
        assert_eq!(steps.iter().filter(|s| **s == Step::Nothing).count(), states.len() - 2);
        assert!(lifecycle.has_ended() && !lifecycle.runs() && lifecycle.states() == states);
    }

    #[test]
    fn session_resumes_after_headset_is_put_on_again() {
        let (steps, lifecycle) = steps(&[Idle, Ready, Synchronized, Stopping, Idle, Ready, Synchronized]);
        assert_eq!(steps.iter().filter(|s| **s == Step::Begin).count(), 2);
        assert!(lifecycle.runs() && !lifecycle.has_ended());
    }

    #[test]
    fn loss_ends_the_session_in_any_state() {
        for before in [Idle, Ready, Synchronized, Visible, Focused, Stopping] {
            let (steps, lifecycle) = steps(&[Ready, before, LossPending]);
            assert_eq!(steps[2], Step::Nothing, "a session that is being lost is not ended");
            assert!(lifecycle.has_ended() && !lifecycle.runs());
        }
    }

    #[test]
    fn repeated_states_do_nothing() {
        let (steps, _) = steps(&[Ready, Ready, Stopping, Stopping]);
        assert_eq!(steps, [Step::Begin, Step::Nothing, Step::End, Step::Nothing]);
    }

    #[test]
    fn number_of_remembered_states_is_bounded() {
        let mut lifecycle = Lifecycle::default();
        for _ in 0..REMEMBERED {
            assert_eq!([Visible, Focused].map(|state| lifecycle.enter(state)), [Step::Nothing; 2]);
        }
        lifecycle.enter(Exiting);
        assert!(lifecycle.has_ended() && lifecycle.states().len() == REMEMBERED);
    }
}
