//! Pictures of a trajectory: states, actions and reward over time, with bounds and set-points.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;

use crate::catalogue::Element;
use crate::setup::Setup;
use crate::trajectory::{Table, WriteError, write_whole};

/// Most panels of one family; models of distributed processes have thousands of states.
const MAX_PANELS: usize = 12;
const WIDTH: u32 = 900;
const PANEL: u32 = 170;

/// One curve with what it is to be compared with.
struct Panel {
    title: String,
    values: Vec<f64>,
    /// Bounds, drawn where they are near the curve.
    bounds: [f64; 2],
    set_point: Option<f64>,
    course: Course,
}

/// How a quantity goes from one row to the next.
enum Course {
    /// Along a line.
    Line,
    /// Held over the step that ends in the row.
    Held,
    /// Switched at the time that the row tells.
    Switched(Vec<f64>),
}

/// Writes an SVG file.
///
/// # Errors
/// [`WriteError`] with the path.
pub fn write(table: &Table, setup: &Setup, path: &Path) -> Result<(), WriteError> {
    write_whole(path, |out| {
        let svg = draw(table, setup).map_err(std::io::Error::other)?;
        out.write_all(svg.as_bytes())
    })
}

fn draw(table: &Table, setup: &Setup) -> Result<String, String> {
    let panels = panels(table, setup);
    let time = table.numbers("time").unwrap_or_default();
    let unit = &setup.model().interface().time.1;
    let mut svg = String::new();
    {
        let height = PANEL * (panels.len().max(1) as u32);
        let root = SVGBackend::with_string(&mut svg, (WIDTH, height)).into_drawing_area();
        root.fill(&WHITE).map_err(|e| e.to_string())?;
        for (area, panel) in root.split_evenly((panels.len().max(1), 1)).iter().zip(&panels) {
            draw_panel(area, panel, &time, unit)?;
        }
        root.present().map_err(|e| e.to_string())?;
    }
    Ok(svg)
}

fn panels(table: &Table, setup: &Setup) -> Vec<Panel> {
    let catalogue = &setup.catalogue;
    let has_steady = setup.model().interface().has_steady;
    let of = |element: &Element, held: bool, set_point: Option<f64>| {
        let unit = if element.unit == "1" { String::new() } else { format!(" [{}]", element.unit) };
        Some(Panel {
            title: format!("{}{unit}", element.name),
            values: table.numbers(&element.name)?,
            bounds: [element.low, element.high],
            set_point,
            course: if held { Course::Held } else { Course::Line },
        })
    };
    let steady = setup.steady_state();
    let set_point = |element: &Element| steady.get(element.at).copied().filter(|x| has_steady && x.is_finite());
    let states = catalogue.states.elements().iter().take(MAX_PANELS).filter_map(|e| of(e, false, set_point(e)));
    let actions = catalogue.actions.elements().iter().take(MAX_PANELS).filter_map(|e| of(e, true, None));
    let mut panels: Vec<Panel> = states.chain(actions).collect();
    let bounds = [f64::NEG_INFINITY, f64::INFINITY];
    let phases = &setup.model().interface().phases;
    if !phases.is_empty() {
        let names: Vec<String> = phases.iter().enumerate().map(|(i, name)| format!("{} {name}", i + 1)).collect();
        let title = format!("phase: {}", names.join(", "));
        let course = Course::Switched(table.numbers("phase_start").unwrap_or_default());
        panels.extend(table.numbers("phase").map(|values| Panel { title, values, bounds, set_point: None, course }));
    }
    let course = Course::Line;
    panels.extend(table.numbers("reward").map(|values| Panel { title: "reward".into(), values, bounds, set_point: None, course }));
    panels
}

fn draw_panel<DB: DrawingBackend>(area: &DrawingArea<DB, Shift>, panel: &Panel, time: &[f64], unit: &str) -> Result<(), String> {
    let text = |e: DrawingAreaErrorKind<DB::ErrorType>| e.to_string();
    let points: Vec<(f64, f64)> = curve(time, &panel.values, &panel.course);
    let end = time.last().copied().filter(|t| *t > 0.0).unwrap_or(1.0);
    let (low, high) = span(&points, panel.set_point);
    let mut chart = ChartBuilder::on(area)
        .margin(6)
        .caption(&panel.title, ("sans-serif", 14))
        .x_label_area_size(24)
        .y_label_area_size(70)
        .build_cartesian_2d(0.0..end, low..high)
        .map_err(text)?;
    chart.configure_mesh().light_line_style(TRANSPARENT).x_desc(unit).max_light_lines(1).y_labels(5).draw().map_err(text)?;
    for bound in panel.bounds.into_iter().filter(|b| (low..=high).contains(b)) {
        chart.draw_series(LineSeries::new([(0.0, bound), (end, bound)], RED.mix(0.6))).map_err(text)?;
    }
    if let Some(value) = panel.set_point {
        chart.draw_series(LineSeries::new([(0.0, value), (end, value)], GREEN.mix(0.7))).map_err(text)?;
    }
    chart.draw_series(LineSeries::new(points, BLUE.stroke_width(2))).map_err(text)?;
    Ok(())
}

/// Finite points of a curve; what does not go along a line as a staircase.
fn curve(time: &[f64], values: &[f64], course: &Course) -> Vec<(f64, f64)> {
    let mut points = Vec::new();
    let mut before: Option<(f64, f64)> = None;
    for (i, (&t, &x)) in time.iter().zip(values).enumerate() {
        match (course, before.filter(|_| x.is_finite())) {
            (Course::Held, Some((last, _))) => points.push((last, x)),
            (Course::Switched(starts), Some((last, held))) if held != x => {
                let switch = starts.get(i).copied().unwrap_or(t).max(last).min(t);
                points.extend([(switch, held), (switch, x)]);
            }
            _ => {}
        }
        if x.is_finite() {
            points.push((t, x));
        }
        before = Some((t, x));
    }
    points
}

/// Range of the ordinate: that of the curve and the set-point, a little widened.
fn span(points: &[(f64, f64)], set_point: Option<f64>) -> (f64, f64) {
    let values = points.iter().map(|p| p.1).chain(set_point.filter(|s| s.is_finite()));
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return (0.0, 1.0);
    }
    let margin = (0.05 * (high - low)).max(1e-6 * high.abs().max(low.abs())).max(1e-12);
    (low - margin, high + margin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_held_curve_is_a_staircase_and_gaps_are_left_out() {
        let points = curve(&[0.0, 1.0, 2.0], &[f64::NAN, 3.0, 4.0], &Course::Held);
        assert_eq!(points, [(0.0, 3.0), (1.0, 3.0), (1.0, 4.0), (2.0, 4.0)]);
        assert_eq!(curve(&[0.0, 1.0], &[f64::NAN, 3.0], &Course::Line), [(1.0, 3.0)]);
    }

    #[test]
    fn a_phase_is_drawn_from_its_start_on() {
        // The second phase begins at 1.5, within the step from 1 to 2; the third with the step from 3 on.
        let starts = Course::Switched(vec![0.0, 0.0, 1.5, 1.5, 3.0]);
        let points = curve(&[0.0, 1.0, 2.0, 3.0, 4.0], &[1.0, 1.0, 2.0, 2.0, 3.0], &starts);
        let stairs = [(0.0, 1.0), (1.0, 1.0), (1.5, 1.0), (1.5, 2.0), (2.0, 2.0), (3.0, 2.0), (3.0, 2.0), (3.0, 3.0), (4.0, 3.0)];
        assert_eq!(points, stairs);
    }

    #[test]
    fn the_ordinate_has_a_range_whatever_the_values() {
        assert_eq!(span(&[], None), (0.0, 1.0));
        let (low, high) = span(&[(0.0, 5.0)], None);
        assert!(low < 5.0 && high > 5.0);
    }
}
