//! The window: sends its events to the renderer's thread and shows that thread's frames.

use std::collections::HashSet;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Instant;

use anyhow::{Context, anyhow};
use diptych::image::Extent;
use diptych::image::display::DisplayImage;
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{ElementState, KeyEvent, MouseButton, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoopProxy};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::window::{Window, WindowId};

use super::layout::Layout;
use super::overlay::{Overlay, Parts};
use super::present::{Drawing, Presenter};
use super::renderer::{self, Start};
use super::shared::{Shared, Status};
use super::status::ViewStatus;
use crate::console;
use crate::failure::Failure;

/// Reason why the renderer's thread wakes the window.
#[derive(Clone, Copy, Debug)]
pub enum Wake {
    Frame,
    Ended,
}

pub struct App {
    look: ViewStatus,
    /// Inputs of the renderer's thread; `None` once the window has opened.
    start: Option<Start>,
    shared: Arc<Shared>,
    proxy: EventLoopProxy<Wake>,
    renderer: Option<JoinHandle<Result<(), Failure>>>,
    open: Option<Open>,
    failure: Option<anyhow::Error>,
}

/// State of the open window.
struct Open {
    window: Arc<Window>,
    presenter: Presenter,
    overlay: Overlay,
    status: Status,
    drawing: Drawing,
    layout: Layout,
    parts: Parts,
    held: HashSet<KeyCode>,
    pointer: [f64; 2],
    drags: bool,
    drawn: Option<Instant>,
}

impl App {
    pub fn new(look: ViewStatus, start: Start, shared: Arc<Shared>, proxy: EventLoopProxy<Wake>) -> Self {
        Self { look, start: Some(start), shared, proxy, renderer: None, open: None, failure: None }
    }

    /// Stops the renderer's thread and waits for it. Returns the last picture in the window if `wants_picture`.
    pub fn end(mut self, wants_picture: bool) -> Result<Option<DisplayImage>, Failure> {
        self.shared.end();
        let rendered = self.renderer.take().map(JoinHandle::join);
        if let Some(failure) = self.failure {
            return Err(Failure::Run(failure));
        }
        rendered.transpose().map_err(|_| anyhow!("the render thread panicked"))?.transpose()?;
        let Some(mut open) = self.open.filter(|_| wants_picture) else { return Ok(None) };
        Ok(Some(open.presenter.capture(&open.drawing)?))
    }

    fn fail(&mut self, events: &ActiveEventLoop, failure: anyhow::Error) {
        self.failure.get_or_insert(failure);
        events.exit();
    }

    fn open(&mut self, events: &ActiveEventLoop) -> Result<(), anyhow::Error> {
        let Some(start) = self.start.take() else { return Ok(()) };
        let size = first_size(self.look.eye);
        let title = format!("diptych: {}", self.look.scene);
        let attributes = Window::default_attributes().with_title(title).with_inner_size(size);
        let window = Arc::new(events.create_window(attributes).context("cannot open a window")?);
        let presenter = Presenter::new(Arc::clone(&window), self.look.eye)?;
        window.request_redraw();
        self.open = Some(Open {
            window,
            presenter,
            overlay: Overlay::new(),
            status: Status::default(),
            drawing: Drawing::default(),
            layout: Layout::default(),
            parts: Parts { panel: true, help: false, hint: true },
            held: HashSet::new(),
            pointer: [0.0; 2],
            drags: false,
            drawn: None,
        });
        let (shared, proxy) = (Arc::clone(&self.shared), self.proxy.clone());
        let enter = console::enter();
        let render = move || {
            let _run = enter();
            // Ignore failures: the window may have closed.
            let wake = |why| {
                let _ = proxy.send_event(why);
            };
            let result = renderer::run(start, &shared, || wake(Wake::Frame));
            wake(Wake::Ended);
            result
        };
        let thread = std::thread::Builder::new().name("control loop".to_owned()).spawn(render);
        self.renderer = Some(thread.context("cannot start a thread")?);
        Ok(())
    }
}

/// Returns the window's initial size: both eyes side by side, magnified by the largest integer factor at which they fit
/// into 1280×720 pixels. The window has at least 800×450 pixels.
fn first_size(Extent { width, height }: Extent) -> PhysicalSize<u32> {
    let scale = (1280 / (2 * width)).min(720 / height).max(1);
    PhysicalSize::new((2 * width * scale + 4).max(800), (height * scale).max(450))
}

impl ApplicationHandler<Wake> for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        events.set_control_flow(ControlFlow::Wait);
        if let Err(failure) = self.open(events) {
            self.fail(events, failure);
        }
    }

    fn user_event(&mut self, events: &ActiveEventLoop, why: Wake) {
        let Some(open) = &mut self.open else { return };
        match why {
            Wake::Frame => {
                if open.drawn.is_none_or(|at| at.elapsed() >= open.presenter.least_interval()) {
                    open.window.request_redraw();
                }
            }
            Wake::Ended => {
                // Draw the last frame, which the minimum interval may have skipped.
                if let Err(failure) = open.redraw(&self.look, &self.shared) {
                    self.failure.get_or_insert(failure);
                }
                events.exit();
            }
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        let Some(open) = &mut self.open else { return };
        match event {
            WindowEvent::CloseRequested | WindowEvent::Destroyed => events.exit(),
            WindowEvent::Resized(_) | WindowEvent::ScaleFactorChanged { .. } => {
                open.presenter.resize();
                open.window.request_redraw();
            }
            WindowEvent::RedrawRequested => {
                if let Err(failure) = open.redraw(&self.look, &self.shared) {
                    self.fail(events, failure);
                }
            }
            WindowEvent::Focused(false) => {
                open.held.clear();
                open.update_moves(&self.shared);
            }
            WindowEvent::CursorMoved { position, .. } => open.point(&self.look, &self.shared, [position.x, position.y]),
            WindowEvent::MouseInput { state, button: MouseButton::Right, .. } => {
                open.drags = state == ElementState::Pressed;
            }
            WindowEvent::KeyboardInput { event, .. } => {
                open.key(events, &self.shared, &event);
            }
            _ => {}
        }
    }
}

impl Open {
    fn redraw(&mut self, look: &ViewStatus, shared: &Shared) -> Result<(), anyhow::Error> {
        self.drawn = Some(Instant::now());
        let (picture, status) = shared.take_output();
        let presented_after_ms = self.status.presented_after_ms;
        self.status = Status { presented_after_ms, ..status };
        if let Some(picture) = &picture {
            let _span = tracing::info_span!("upload images").entered();
            self.presenter.upload(picture);
        }
        let size = self.presenter.size();
        // There are no images before the first frame.
        self.drawing.placements =
            if self.status.frames.is_empty() { Vec::new() } else { self.layout.placements(size, look.eye) };
        let (painted, textures) = self.overlay.paint(
            size,
            self.window.scale_factor() as f32,
            look,
            &self.status,
            &self.drawing.placements,
            self.parts,
        );
        self.drawing.overlay = painted;
        self.presenter.take_textures(textures);
        let is_presented = {
            let _span = tracing::info_span!("present").entered();
            self.presenter.present(&self.drawing)?
        };
        if !is_presented {
            self.window.request_redraw();
        } else if let Some(last) = self.status.frames.back().filter(|_| picture.is_some()) {
            self.status.presented_after_ms = Some(last.posed.elapsed().as_secs_f64() * 1e3);
        }
        Ok(())
    }

    fn point(&mut self, look: &ViewStatus, shared: &Shared, to: [f64; 2]) {
        let from = std::mem::replace(&mut self.pointer, to);
        let placements = self.layout.placements(self.presenter.size(), look.eye);
        let gaze = placements.iter().find_map(|p| p.within(to));
        // A drag over an eye's height turns by about a radian.
        let radians = placements.first().map_or(0.0, |p| 1.0 / p.height().max(1.0));
        shared.change_input(|input| {
            input.gaze = gaze.or(input.gaze);
            if self.drags {
                input.dragged_rad[0] += (to[0] - from[0]) * radians;
                input.dragged_rad[1] -= (to[1] - from[1]) * radians;
            }
        });
    }

    fn key(&mut self, events: &ActiveEventLoop, shared: &Shared, event: &KeyEvent) {
        let PhysicalKey::Code(code) = event.physical_key else { return };
        if event.state == ElementState::Released {
            self.held.remove(&code);
            return self.update_moves(shared);
        }
        if event.repeat {
            return;
        }
        match code {
            KeyCode::Escape => events.exit(),
            KeyCode::Tab => self.layout = self.layout.next(),
            KeyCode::KeyN => self.drawing.is_sharp ^= true,
            KeyCode::KeyO => self.parts.panel ^= true,
            KeyCode::KeyH => self.parts.help ^= true,
            KeyCode::KeyP => shared.change_input(|input| input.toggles_path ^= true),
            _ => {
                self.held.insert(code);
                self.update_moves(shared);
            }
        }
        self.window.request_redraw();
    }

    fn update_moves(&self, shared: &Shared) {
        let axis = |more: KeyCode, less: KeyCode| {
            let held = |code| f64::from(u8::from(self.held.contains(&code)));
            held(more) - held(less)
        };
        use KeyCode::{ArrowDown, ArrowLeft, ArrowRight, ArrowUp, KeyA, KeyD, KeyE, KeyQ, KeyS, KeyW};
        shared.change_input(|input| {
            input.moves = [axis(KeyD, KeyA), axis(KeyE, KeyQ), axis(KeyW, KeyS)];
            input.turns = [axis(ArrowRight, ArrowLeft), axis(ArrowUp, ArrowDown)];
            input.is_fast = self.held.contains(&KeyCode::ShiftLeft) || self.held.contains(&KeyCode::ShiftRight);
        });
    }
}
