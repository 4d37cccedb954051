//! Overlay on the images: frame times, settings, rows per device, foveal layers and keys.

use egui::{
    Align2, Area, ClippedPrimitive, Color32, FontId, Frame, Margin, Pos2, Rect, RichText, Sense, Shape, Stroke,
};
use egui::{TexturesDelta, Ui, Vec2, pos2, vec2};

use super::layout::Placement;
use super::shared::{FrameStatus, Status};
use super::status::ViewStatus;

/// egui's output, ready to be drawn.
#[derive(Default)]
pub struct Painted {
    pub primitives: Vec<ClippedPrimitive>,
    pub pixels_per_point: f32,
}

/// Parts of the overlay that are on.
#[derive(Clone, Copy, Debug)]
pub struct Parts {
    pub panel: bool,
    pub help: bool,
    /// Shows the hint "H: keys" while the list of keys is hidden; false if there is no keyboard.
    pub hint: bool,
}

pub struct Overlay {
    context: egui::Context,
}

const PANEL: Color32 = Color32::from_rgba_premultiplied(10, 11, 13, 205);
const TEXT: Color32 = Color32::from_rgb(226, 228, 232);
const DIM: Color32 = Color32::from_rgb(150, 155, 163);
const IN_BAND: Color32 = Color32::from_rgb(116, 196, 118);
const OUT_OF_BAND: Color32 = Color32::from_rgb(240, 142, 78);
const LAYERS: Color32 = Color32::from_rgb(0, 220, 255);
const DEVICES: [Color32; 6] = [
    Color32::from_rgb(78, 138, 214),
    Color32::from_rgb(224, 166, 70),
    Color32::from_rgb(102, 172, 130),
    Color32::from_rgb(190, 108, 168),
    Color32::from_rgb(150, 150, 90),
    Color32::from_rgb(120, 170, 190),
];
/// Width of the plot and of the bar of rows per device, points.
const WIDTH: f32 = 264.0;

const KEYS: [(&str, &str); 9] = [
    ("W A S D, Q E", "move; Shift: faster"),
    ("arrows, right drag", "turn"),
    ("P", "follow or leave the shot's path"),
    ("mouse", "the gaze, with --foveation"),
    ("Tab", "side by side, anaglyph, left, right"),
    ("N", "smooth or sharp pixels"),
    ("O", "this overlay"),
    ("H", "these keys"),
    ("Esc", "quit"),
];

impl Overlay {
    pub fn new() -> Self {
        let context = egui::Context::default();
        context.set_visuals(egui::Visuals::dark());
        context.all_styles_mut(|style| {
            style.spacing.item_spacing = vec2(6.0, 3.0);
            style.spacing.interact_size.y = 11.0;
            style.visuals.override_text_color = Some(TEXT);
            style.wrap_mode = Some(egui::TextWrapMode::Extend);
        });
        Self { context }
    }

    /// Paints the overlay for a window of `size` pixels.
    pub fn paint(
        &self,
        size: [u32; 2],
        pixels_per_point: f32,
        look: &ViewStatus,
        status: &Status,
        placements: &[Placement],
        parts: Parts,
    ) -> (Painted, TexturesDelta) {
        let [width, height] = size.map(|n| n as f32 / pixels_per_point);
        let mut input = egui::RawInput {
            screen_rect: Some(Rect::from_min_size(Pos2::ZERO, vec2(width, height))),
            ..Default::default()
        };
        input.viewports.entry(egui::ViewportId::ROOT).or_default().native_pixels_per_point = Some(pixels_per_point);
        let output = self.context.run_ui(input, |ui| {
            if look.is_foveated {
                let painter = ui.painter();
                placements.iter().for_each(|p| layers(painter, p, status, pixels_per_point, parts.panel));
            }
            if parts.panel {
                area(ui, "panel", Align2::LEFT_TOP, |ui| panel(ui, look, status));
            }
            if status.frames.is_empty() {
                area(ui, "wait", Align2::CENTER_CENTER, |ui| {
                    ui.label("warming up the devices and timing settings …");
                });
            }
            if parts.help {
                area(ui, "help", Align2::RIGHT_TOP, help);
            } else if parts.panel && parts.hint {
                area(ui, "hint", Align2::RIGHT_TOP, |ui| {
                    ui.label(RichText::new("H: keys").color(DIM));
                });
            }
        });
        let pixels_per_point = output.pixels_per_point;
        let primitives = self.context.tessellate(output.shapes, pixels_per_point);
        (Painted { primitives, pixels_per_point }, output.textures_delta)
    }
}

fn area(ui: &Ui, name: &str, corner: Align2, contents: impl FnOnce(&mut Ui)) {
    let inwards = corner.to_sign() * -10.0;
    Area::new(egui::Id::unique(name)).interactable(false).anchor(corner, inwards).show(ui.ctx(), |ui| {
        Frame::new().fill(PANEL).corner_radius(5.0).inner_margin(Margin::same(9)).show(ui, contents);
    });
}

fn panel(ui: &mut Ui, look: &ViewStatus, status: &Status) {
    let place = if status.follows_path { "on its path" } else { "free" };
    ui.label(RichText::new(format!("{}, {}, {place}", look.scene, look.eye)).strong());
    let Some(last) = status.frames.back() else { return };
    let [lo_ms, hi_ms] = look.band_ms;
    let colour = if last.in_band { IN_BAND } else { OUT_OF_BAND };
    ui.label(RichText::new(format!("{:.1} ms, {:.1} frames per second", last.makespan_ms, rate(status))).color(colour));
    if let Some(ms) = status.presented_after_ms {
        ui.label(format!("{ms:.1} ms from pose to presentation"));
    }
    plot(ui, look.band_ms, status);
    let share = 100.0 * status.in_band as f64 / status.count as f64;
    ui.label(format!("{share:.1} % of {} frames within {lo_ms} to {hi_ms} ms", status.count));
    ui.label(format!("rung {} of 0 to {}: {}", last.rung, status.rungs.saturating_sub(1), last.quality,));
    if let Some(ev) = status.metered_ev {
        ui.label(format!("metered exposure: {ev:+.1} EV"));
    }
    ui.add_space(3.0);
    shares(ui, &look.devices, last);
}

/// Returns the frame rate over the last thirty frames, Hz.
fn rate(status: &Status) -> f64 {
    let recent = status.frames.len().min(30);
    let first = &status.frames[status.frames.len() - recent];
    let passed_s = status.frames.back().map_or(0.0, |last| (last.at - first.at).as_secs_f64());
    if passed_s > 0.0 { (recent - 1) as f64 / passed_s } else { 0.0 }
}

/// Plots the recent frame times, with the budget as a shaded band.
fn plot(ui: &mut Ui, [lo_ms, hi_ms]: [f64; 2], status: &Status) {
    let (rect, _) = ui.allocate_exact_size(vec2(WIDTH, 68.0), Sense::hover());
    let painter = ui.painter_at(rect);
    let longest_ms = status.frames.iter().fold(0.0, |most: f64, frame| most.max(frame.makespan_ms));
    let most_ms = (1.05 * longest_ms).clamp(1.5 * hi_ms, 4.0 * hi_ms);
    let y = |ms: f64| rect.bottom() - 1.0 - (rect.height() - 2.0) * (ms / most_ms).min(1.0) as f32;
    painter.rect_filled(rect, 2.0, Color32::from_black_alpha(120));
    let band = Rect::from_x_y_ranges(rect.x_range(), y(hi_ms)..=y(lo_ms));
    painter.rect_filled(band, 0.0, IN_BAND.gamma_multiply(0.22));
    let column = rect.width() / 120.0;
    let x = |i: usize| rect.right() - column * (status.frames.len() - i) as f32 + 0.5 * column;
    let line: Vec<Pos2> = status.frames.iter().enumerate().map(|(i, f)| pos2(x(i), y(f.makespan_ms))).collect();
    painter.add(Shape::line(line, Stroke::new(1.3, TEXT)));
    for (i, frame) in status.frames.iter().enumerate().filter(|(_, frame)| !frame.in_band) {
        painter.circle_filled(pos2(x(i), y(frame.makespan_ms)), 1.7, OUT_OF_BAND);
    }
    for (ms, align) in [(hi_ms, Align2::LEFT_BOTTOM), (lo_ms, Align2::LEFT_TOP)] {
        painter.text(pos2(rect.left() + 3.0, y(ms)), align, format!("{ms} ms"), FontId::proportional(10.0), DIM);
    }
}

/// Draws a bar of each device's fraction of the rows in the last frame, and lists the devices' names and percentages.
fn shares(ui: &mut Ui, devices: &[String], last: &FrameStatus) {
    let rows: u32 = last.stripes.iter().sum();
    let share = |rows_of: u32| f64::from(rows_of) / f64::from(rows.max(1));
    let (rect, _) = ui.allocate_exact_size(vec2(WIDTH, 11.0), Sense::hover());
    let mut left = rect.left();
    for (i, &stripe) in last.stripes.iter().enumerate() {
        let width = rect.width() * share(stripe) as f32;
        let part = Rect::from_min_size(pos2(left, rect.top()), vec2((width - 1.0).max(0.0), rect.height()));
        ui.painter().rect_filled(part, 1.0, DEVICES[i % DEVICES.len()]);
        left += width;
    }
    for (i, (device, &stripe)) in devices.iter().zip(&last.stripes).enumerate() {
        ui.horizontal(|ui| {
            let (mark, _) = ui.allocate_exact_size(Vec2::splat(9.0), Sense::hover());
            ui.painter().rect_filled(mark, 1.0, DEVICES[i % DEVICES.len()]);
            let what = if stripe == 0 { "none".to_owned() } else { format!("{:.0} %", 100.0 * share(stripe)) };
            ui.label(RichText::new(format!("{device}: {what}")).color(DIM).small());
        });
    }
}

/// Draws the borders of foveal layers, if `with_circles`, and a cross at the gaze.
fn layers(painter: &egui::Painter, placement: &Placement, status: &Status, pixels_per_point: f32, with_circles: bool) {
    let Some(eyes) = status.circles else { return };
    let (radii, gaze) = eyes[placement.eye_index()];
    let points = |pixels: f64| pixels as f32 / pixels_per_point;
    let [x, y] = [placement.x + gaze[0] * placement.scale, placement.y + gaze[1] * placement.scale].map(points);
    let corner = pos2(points(placement.x), points(placement.y));
    let image = Rect::from_min_size(corner, vec2(points(placement.width()), points(placement.height())));
    let painter = painter.with_clip_rect(image);
    if with_circles {
        for radius in radii {
            painter.circle_stroke(pos2(x, y), points(radius * placement.scale), Stroke::new(1.0, LAYERS));
        }
    }
    for reach in [vec2(6.0, 0.0), vec2(0.0, 6.0)] {
        painter.line_segment([pos2(x, y) - reach, pos2(x, y) + reach], Stroke::new(1.0, LAYERS));
    }
}

fn help(ui: &mut Ui) {
    egui::Grid::new("keys").num_columns(2).spacing(vec2(14.0, 3.0)).show(ui, |ui| {
        for (key, what) in KEYS {
            ui.label(RichText::new(key).strong());
            ui.label(what);
            ui.end_row();
        }
    });
}
