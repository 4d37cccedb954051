//! Draws line charts as SVG, readable on white and in print. SVG viewers render the text, so no font is needed here.

use plotters::chart::ChartContext;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, ValueFormatter};
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::ReportError;
use super::ticks::{self, Ticks};

/// Colours of Okabe & Ito (2008), which colour-blind readers can distinguish.
const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];
const GUIDE: RGBColor = RGBColor(120, 120, 120);
const GRID: RGBColor = RGBColor(225, 225, 225);
const INK: RGBColor = RGBColor(40, 40, 40);
const SIZE_PX: (u32, u32) = (800, 500);

/// A line of a chart.
#[derive(Clone, Debug, Default)]
pub struct Series {
    pub name: String,
    pub points: Vec<(f64, f64)>,
    /// Text beside each point; none for further points.
    pub labels: Vec<String>,
    /// Low and high values around each point, drawn as a shaded band.
    pub band: Option<Vec<(f64, f64)>>,
    /// True for a guide such as ideal speedup, drawn grey and dashed without dots.
    pub guide: bool,
    /// Measurements that the line does not join.
    pub dots: Vec<Dot>,
}

/// A measurement, drawn as a small dot with its intervals.
#[derive(Clone, Debug, Default)]
pub struct Dot {
    pub at: (f64, f64),
    /// Intervals along the horizontal and the vertical axis.
    pub within: [Option<[f64; 2]>; 2],
    /// True for a dot that is not filled.
    pub hollow: bool,
}

#[derive(Clone, Debug, Default)]
pub struct Axis {
    pub label: String,
    pub log: bool,
    /// True for ticks at powers of two on a logarithmic axis.
    pub doubles: bool,
}

#[derive(Clone, Debug, Default)]
pub struct Chart {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
}

impl Chart {
    /// Creates a chart with these labels of the horizontal and the vertical axis, which are both linear or both
    /// logarithmic.
    pub fn new(title: String, labels: [&str; 2], log: bool) -> Self {
        let [x, y] = labels.map(|label| Axis { label: label.to_owned(), log, doubles: false });
        Self { title, x, y }
    }
}

type Canvas<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<Ticks, Ticks>>;
type DrawingError = Box<dyn std::error::Error>;

/// Draws the series as lines with dots, a legend and round ticks. Omits points that are not finite, or not positive on
/// a logarithmic axis.
///
/// # Errors
/// [`ReportError::NothingToDraw`] if no point is left.
pub fn line_chart_svg(chart: &Chart, series: &[Series]) -> Result<String, ReportError> {
    let mut colours = COLOURS.into_iter().cycle();
    let mut place = |s| Drawn::place(chart, s, &mut colours);
    let lines: Vec<Drawn> = series.iter().map(&mut place).collect();
    let axes = fit_axes(chart, &lines).ok_or_else(|| ReportError::NothingToDraw { title: chart.title.clone() })?;
    let mut svg = String::new();
    draw(&mut svg, chart, &axes, &lines)
        .map_err(|e| ReportError::Drawing { title: chart.title.clone(), reason: e.to_string() })?;
    Ok(svg)
}

/// A series in axis coordinates.
struct Drawn<'s> {
    series: &'s Series,
    colour: RGBColor,
    points: Vec<(f64, f64)>,
    /// Points of the band: x, low and high y.
    band: Vec<(f64, f64, f64)>,
    dots: Vec<Dot>,
}

impl<'s> Drawn<'s> {
    fn place(chart: &Chart, series: &'s Series, colours: &mut impl Iterator<Item = RGBColor>) -> Self {
        let colour = if series.guide { GUIDE } else { colours.next().unwrap_or(INK) };
        let x = |v| ticks::coordinate(v, chart.x.log);
        let y = |v| ticks::coordinate(v, chart.y.log);
        let points = series.points.iter().filter_map(|p| Some((x(p.0)?, y(p.1)?))).collect();
        let around = series.points.iter().zip(series.band.iter().flatten());
        let band = around.filter_map(|(p, b)| Some((x(p.0)?, y(b.0)?, y(b.1)?))).collect();
        let dots = series.dots.iter().filter_map(|dot| {
            // A logarithmic axis shows no interval that reaches 0.
            let [across, up] = dot.within;
            let within = [(across, chart.x.log), (up, chart.y.log)].map(|(ends, log)| {
                let [low, high] = ends?.map(|end| ticks::coordinate(end, log));
                Some([low?, high?])
            });
            Some(Dot { at: (x(dot.at.0)?, y(dot.at.1)?), within, hollow: dot.hollow })
        });
        Self { series, colour, points, band, dots: dots.collect() }
    }

    /// Returns the ends of the intervals of all dots.
    fn bars(&self) -> Vec<[(f64, f64); 2]> {
        let bars = |dot: &Dot| {
            let ((x, y), [across, up]) = (dot.at, dot.within);
            [across.map(|ends| ends.map(|x| (x, y))), up.map(|ends| ends.map(|y| (x, y)))]
        };
        self.dots.iter().flat_map(bars).flatten().collect()
    }

    fn outline(&self) -> Vec<(f64, f64)> {
        let there = self.band.iter().map(|b| (b.0, b.2));
        let back = self.band.iter().rev().map(|b| (b.0, b.1));
        there.chain(back).collect()
    }
}

impl Ranged for Ticks {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, coordinate: &f64, (begin_px, end_px): (i32, i32)) -> i32 {
        let share = (coordinate - self.range.start) / (self.range.end - self.range.start);
        begin_px + (share * f64::from(end_px - begin_px)).round() as i32
    }

    /// Returns the major ticks. There are no minor ticks.
    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.at.clone() }
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.range.clone()
    }
}

impl ValueFormatter<f64> for Ticks {
    fn format_ext(&self, coordinate: &f64) -> String {
        self.label(*coordinate)
    }
}

fn fit_axes(chart: &Chart, lines: &[Drawn]) -> Option<[Ticks; 2]> {
    let dots = |l: &Drawn| l.dots.iter().map(|dot| dot.at).chain(l.bars().into_flattened()).collect();
    let all: Vec<(f64, f64)> = lines.iter().flat_map(|l| [l.points.clone(), l.outline(), dots(l)]).flatten().collect();
    let fit = |axis: &Axis, values: Vec<f64>| {
        let ticks = Ticks::fit(values.into_iter(), axis.log)?;
        Some(if axis.doubles { ticks.with_doubles() } else { ticks })
    };
    let x = fit(&chart.x, all.iter().map(|p| p.0).collect())?;
    Some([x, fit(&chart.y, all.iter().map(|p| p.1).collect())?])
}

fn draw(svg: &mut String, chart: &Chart, axes: &[Ticks; 2], lines: &[Drawn]) -> Result<(), DrawingError> {
    let area = SVGBackend::with_string(svg, SIZE_PX).into_drawing_area();
    area.fill(&WHITE)?;
    let [x, y] = axes.clone();
    let mut canvas = ChartBuilder::on(&area)
        .caption(&chart.title, ("sans-serif", 22).into_font().color(&INK))
        .margin(16)
        .x_label_area_size(48)
        .y_label_area_size(64)
        .build_cartesian_2d(x, y)?;
    draw_axes(&mut canvas, chart)?;
    for line in lines {
        draw_line(&mut canvas, line)?;
    }
    draw_legend(&mut canvas, legend_corner(axes, lines))?;
    drop(canvas);
    area.present()?;
    Ok(())
}

fn draw_axes(canvas: &mut Canvas, chart: &Chart) -> Result<(), DrawingError> {
    canvas
        .configure_mesh()
        .x_desc(&chart.x.label)
        .y_desc(&chart.y.label)
        .axis_style(INK)
        .bold_line_style(GRID)
        .light_line_style(TRANSPARENT)
        .label_style(("sans-serif", 14).into_font().color(&INK))
        .axis_desc_style(("sans-serif", 16).into_font().color(&INK))
        .draw()?;
    Ok(())
}

fn draw_line(canvas: &mut Canvas, line: &Drawn) -> Result<(), DrawingError> {
    let (name, points) = (&line.series.name, line.points.iter().copied());
    if line.series.guide {
        let stroke = line.colour.stroke_width(1);
        let dashes = DashedLineSeries::new(points, 6, 5, stroke);
        let sample = move |(x, y)| DashedPathElement::new([(x, y), (x + 22, y)], 6, 5, stroke);
        canvas.draw_series(dashes)?.label(name).legend(sample);
        return Ok(());
    }
    let stroke = line.colour.stroke_width(2);
    if !line.band.is_empty() {
        canvas.draw_series([Polygon::new(line.outline(), line.colour.mix(0.15))])?;
    }
    let sample = move |(x, y)| PathElement::new([(x, y), (x + 22, y)], stroke);
    canvas.draw_series(LineSeries::new(points.clone(), stroke))?.label(name).legend(sample);
    canvas.draw_series(points.clone().map(|p| Circle::new(p, 4, line.colour.filled())))?;
    let thin = line.colour.mix(0.5);
    canvas.draw_series(line.bars().into_iter().map(|ends| PathElement::new(ends, thin.stroke_width(1))))?;
    let dot = |dot: &Dot| {
        let style = if dot.hollow { line.colour.stroke_width(1) } else { thin.filled() };
        Circle::new(dot.at, 3, style)
    };
    canvas.draw_series(line.dots.iter().map(dot))?;
    // Labels are above their points, left of lines that rise to the right, and right of those that fall.
    let ends = line.points.first().zip(line.points.last());
    let (side, x) = if ends.is_some_and(|(a, b)| b.1 < a.1) { (HPos::Left, 8) } else { (HPos::Right, -8) };
    let style = ("sans-serif", 13).into_font().color(&INK).pos(Pos::new(side, VPos::Bottom));
    let labels = points.zip(&line.series.labels).filter(|(_, text)| !text.is_empty());
    canvas
        .draw_series(labels.map(|(p, text)| EmptyElement::at(p) + Text::new(text.clone(), (x, -6), style.clone())))?;
    Ok(())
}

fn draw_legend(canvas: &mut Canvas, corner: SeriesLabelPosition) -> Result<(), DrawingError> {
    canvas
        .configure_series_labels()
        .position(corner)
        .margin(12)
        .legend_area_size(30)
        .label_font(("sans-serif", 14).into_font().color(&INK))
        .background_style(WHITE.mix(0.85))
        .border_style(GRID)
        .draw()?;
    Ok(())
}

/// Approximate fraction of the chart's width and height that a legend covers.
const LEGEND_SHARE: [f64; 2] = [0.35, 0.3];

/// Returns the corner in which a legend hides the smallest part of the lines.
fn legend_corner(axes: &[Ticks; 2], lines: &[Drawn]) -> SeriesLabelPosition {
    let share = |axis: usize, at: f64| (at - axes[axis].range.start) / (axes[axis].range.end - axes[axis].range.start);
    let along = |pair: &[(f64, f64)]| -> Vec<(f64, f64)> {
        let [a, b] = [pair[0], pair[1]];
        let at = |t: f64| (a.0 + t * (b.0 - a.0), a.1 + t * (b.1 - a.1));
        (0..=16).map(|i| at(f64::from(i) / 16.0)).collect()
    };
    let on_lines = lines.iter().flat_map(|l| l.points.windows(2).flat_map(along));
    let dots = lines.iter().flat_map(|l| l.points.iter().copied().chain(l.dots.iter().map(|dot| dot.at)));
    let dots: Vec<(f64, f64)> = on_lines.chain(dots).collect();
    let crowd = |right: bool, upper: bool| {
        let distance = |is_far: bool, share: f64| if is_far { 1.0 - share } else { share };
        let inside = |p: &&(f64, f64)| {
            distance(right, share(0, p.0)) < LEGEND_SHARE[0] && distance(upper, share(1, p.1)) < LEGEND_SHARE[1]
        };
        dots.iter().filter(inside).count()
    };
    let corners = [
        (crowd(false, true), SeriesLabelPosition::UpperLeft),
        (crowd(true, true), SeriesLabelPosition::UpperRight),
        (crowd(true, false), SeriesLabelPosition::LowerRight),
        (crowd(false, false), SeriesLabelPosition::LowerLeft),
    ];
    corners.into_iter().min_by_key(|c| c.0).map_or(SeriesLabelPosition::UpperLeft, |c| c.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn speedup() -> (Chart, Vec<Series>) {
        let chart = Chart {
            title: "Speed-up <atrium & co>".into(),
            x: Axis { label: "devices".into(), ..Axis::default() },
            y: Axis { label: "speed-up".into(), ..Axis::default() },
        };
        let counts = [1.0, 2.0, 4.0, 8.0];
        let ideal =
            Series { name: "ideal".into(), points: counts.map(|n| (n, n)).to_vec(), guide: true, ..Series::default() };
        let measured = Series {
            name: "measured".into(),
            points: counts.map(|n| (n, n.powf(0.9))).to_vec(),
            band: Some(counts.map(|n| (n.powf(0.85), n.powf(0.93))).to_vec()),
            labels: vec![String::new(), "waits".into(), "too few rows".into()],
            ..Series::default()
        };
        (chart, vec![ideal, measured])
    }

    #[test]
    fn chart_escapes_labels_and_draws_all_parts() {
        let (chart, series) = speedup();
        let svg = line_chart_svg(&chart, &series).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        for text in
            ["Speed-up &lt;atrium &amp; co&gt;", "devices", "speed-up", "ideal", "measured", "waits", "too few rows"]
        {
            assert!(svg.contains(text), "{text}");
        }
        assert_eq!(svg.matches("<circle").count(), 4);
        assert!(svg.contains("<polygon"));
        assert_eq!(svg, line_chart_svg(&chart, &series).unwrap());
    }

    #[test]
    fn dots_have_bars_and_stretch_the_axes() {
        let (chart, mut series) = speedup();
        let dot = |hollow, within| Dot { at: (4.0, 3.0), within, hollow };
        series[1].dots = vec![dot(false, [Some([3.9, 4.1]), None]), dot(true, [None, Some([2.0, 4.0])])];
        let svg = line_chart_svg(&chart, &series).unwrap();
        assert_eq!((svg.matches("<circle").count(), svg.matches("r=\"3\"").count()), (6, 2));
        let lines = |svg: &str| svg.matches("<polyline").count();
        series[1].dots.iter_mut().for_each(|dot| dot.within = [None; 2]);
        assert_eq!(lines(&line_chart_svg(&chart, &series).unwrap()), lines(&svg) - 2);
        series[1].dots[0].within = [None, Some([2.0, 40.0])];
        assert!(!svg.contains("\n40\n") && line_chart_svg(&chart, &series).unwrap().contains("\n40\n"));
    }

    #[test]
    fn points_an_axis_cannot_show_are_left_out() {
        let (mut chart, mut series) = speedup();
        chart.y.log = true;
        series[1].points.extend([(9.0, 0.0), (9.0, -1.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)]);
        let svg = line_chart_svg(&chart, &series).unwrap();
        assert_eq!(svg.matches("<circle").count(), 4);
        assert!(!svg.contains("NaN"));
    }

    #[test]
    fn chart_needs_at_least_one_point() {
        let (mut chart, mut series) = speedup();
        series.truncate(1);
        series[0].points = vec![(3.0, 5.0)];
        for log in [false, true] {
            (chart.x.log, chart.y.log) = (log, log);
            assert!(line_chart_svg(&chart, &series).is_ok());
        }
        series[0].points = vec![(0.0, 1.0)];
        let message = line_chart_svg(&chart, &series).unwrap_err().to_string();
        assert!(message.contains("Speed-up"), "{message}");
        assert!(line_chart_svg(&chart, &[]).is_err());
    }

    #[test]
    fn guide_line_uses_no_colour_of_measured_lines() {
        let (chart, series) = speedup();
        let blue = "stroke=\"#0072B2\"";
        assert!(line_chart_svg(&chart, &series).unwrap().contains(blue));
        assert!(!line_chart_svg(&chart, &series[..1]).unwrap().contains(blue));
    }
}
