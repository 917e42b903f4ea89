//! Interactive pictures: the SVG drawing, its numbers, and a small script that shows values at the
//! pointer and enlarges a part of the time axis. Nothing is fetched.

use serde_json::{Value, json};

use super::Picture;
use super::layout::Placed;
use super::panel::{Body, Panel, Series};
use super::quantity::scaled;
use super::svg::{escaped, hex};

const SCRIPT: &str = include_str!("picture.js");
const STYLE: &str = include_str!("picture.css");

/// A page.
pub(super) fn page(picture: &Picture) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>{}</title>\n</head>\n<body>\n{}</body>\n</html>\n",
        escaped(&picture.drawing.title),
        part(picture, "smpl-picture")
    )
}

/// A part of a page. Names of clip paths are made its own, so that several parts can be on one
/// page.
pub(super) fn part(picture: &Picture, id: &str) -> String {
    let svg = picture.svg().replace("id=\"seen-", &format!("id=\"{id}-seen-")).replace("url(#seen-", &format!("url(#{id}-seen-"));
    // `</` or `<!--` in a text would end the script or comment out its end.
    let data = data(picture).to_string().replace('<', "\\u003c");
    format!(
        "<div class=\"smpl-picture\" id=\"{id}\">\n<style>{STYLE}</style>\n{svg}<div class=\"smpl-reading\" hidden></div>\n\
         <p class=\"smpl-help\">Point at a curve to read it; drag across to enlarge a time, double-click for all of it.</p>\n\
         <script>(function () {{\nconst id = {}, data = {data};\n{SCRIPT}}})();</script>\n</div>\n",
        json!(id)
    )
}

fn data(picture: &Picture) -> Value {
    let panels = picture.panels.panels.iter().zip(&picture.placed).map(|(panel, place)| of_panel(panel, place));
    json!({
        "width": picture.drawing.width,
        "height": picture.drawing.height,
        "timeUnit": picture.panels.time_unit,
        "panels": panels.collect::<Vec<_>>(),
    })
}

fn of_panel(panel: &Panel, place: &Placed) -> Value {
    let frame = [place.plot.x, place.plot.y, place.plot.width, place.plot.height];
    let (series, map) = match &panel.body {
        Body::Curves(curves) => (curves.series.iter().map(of_series).collect(), Value::Null),
        Body::Map(map) => {
            let values: Vec<Value> = map.values.iter().map(|v| rounded(*v)).collect();
            (Vec::new(), json!({"labels": map.labels, "columns": map.columns, "values": values}))
        }
    };
    json!({
        "name": panel.name,
        "unit": scaled(&panel.unit, place.y.exponent),
        "factor": 10_f64.powi(place.y.exponent),
        "text": panel.text,
        "overSpace": panel.over_space,
        "coordinate": panel.coordinate,
        "frame": frame,
        "x": [place.x.low, place.x.high],
        "y": [place.y.low, place.y.high],
        "series": series,
        "map": map,
    })
}

fn of_series(series: &Series) -> Value {
    let numbers = |values: &[f64]| values.iter().map(|v| rounded(*v)).collect::<Vec<_>>();
    json!({"label": series.label, "colour": hex(series.colour), "dots": series.dots, "x": numbers(&series.x), "y": numbers(&series.y)})
}

/// Seven significant digits; null for what is not a number.
fn rounded(value: f64) -> Value {
    format!("{value:.6e}").parse::<f64>().ok().filter(|v| v.is_finite()).map_or(Value::Null, |v| json!(v))
}
