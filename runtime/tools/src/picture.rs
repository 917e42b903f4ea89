//! Pictures of runs: what of a model changes over time and space, on a page to hand to anybody.
//!
//! [`items`] are the quantities that can be shown, and [`plan()`] chooses panels. [`Run`]s have the
//! numbers, with a [`Follower`] also those between sampling instants. [`Picture::new`] lays them
//! out on one [`Drawing`], which is written as SVG, PNG, PDF or as an interactive page of HTML. The
//! same runs give the same bytes.

mod axis;
mod choose;
mod colour;
pub mod drawing;
mod font;
mod html;
mod instances;
pub mod items;
mod layout;
mod legend;
mod make;
mod panel;
mod pdf;
mod plan;
mod plot;
mod quantity;
mod raster;
mod run;
mod svg;

use std::path::Path;

pub use drawing::Drawing;
pub use font::Weight;
pub use layout::Heading;
pub use make::{NominalError, SavedError, nominal, of_tables};
pub use plan::{PageSection, PanelPlan, PlotKind, ShowError, plan, split_names};
pub(crate) use quantity::{duration, short};
pub use run::{Follower, Followings, Run};
pub(crate) use run::{Tracing, followed};
pub(crate) use svg::escaped;

use smpl_runtime::files::{WriteError, write_whole};
use smpl_runtime::setup::Setup;

/// Formats of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Scalable graphics.
    Svg,
    /// A bitmap.
    Png,
    /// A page to print.
    Pdf,
    /// A page to look into: values where it is pointed at, and longer times made wider.
    Html,
}

impl Format {
    /// All formats with the endings of their files.
    pub const ENDINGS: [(&'static str, Format); 4] =
        [("svg", Format::Svg), ("png", Format::Png), ("pdf", Format::Pdf), ("html", Format::Html)];

    /// The format that the ending of a file's name shows.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        let ending = path.extension()?.to_ascii_lowercase();
        Self::ENDINGS.iter().find(|(name, _)| ending == *name).map(|(_, format)| *format)
    }
}

/// A picture.
pub struct Picture {
    drawing: Drawing,
    panels: panel::Panels,
    placed: Vec<layout::Placed>,
}

impl Picture {
    /// Draws panels of runs. `time_unit` is that of the model, empty where it is not known.
    #[must_use]
    pub fn new(plans: &[PanelPlan], runs: &[Run], heading: &Heading, time_unit: &str) -> Self {
        let panels = choose::fill(plans, runs, time_unit);
        let layout::Page { mut drawing, placed } = layout::page(&panels, runs, heading);
        plot::draw(&mut drawing, &panels, &placed, runs, heading);
        Self { drawing, panels, placed }
    }

    /// The drawing.
    #[must_use]
    pub fn drawing(&self) -> &Drawing {
        &self.drawing
    }

    /// Names of what its panels show, in their order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.panels.panels.iter().map(|panel| panel.name.as_str())
    }

    /// As the text of an SVG file.
    #[must_use]
    pub fn svg(&self) -> String {
        svg::text(&self.drawing)
    }

    /// As the text of a page of HTML that needs nothing else.
    #[must_use]
    pub fn html(&self) -> String {
        html::page(self)
    }

    /// As a part of a page of HTML, `id` being its own there.
    #[must_use]
    pub fn html_part(&self, id: &str) -> String {
        html::part(self, id)
    }

    /// Red, green and blue of each pixel, row by row, with height and width.
    ///
    /// # Errors
    /// In words, where the picture is too large to be held.
    pub fn rgb(&self, scale: f64) -> Result<(Vec<u8>, usize, usize), String> {
        raster::rgb(&self.drawing, scale)
    }

    /// The bytes of a file of a format.
    ///
    /// # Errors
    /// In words, where the picture is too large to be held.
    pub fn bytes(&self, format: Format) -> Result<Vec<u8>, String> {
        match format {
            Format::Svg => Ok(self.svg().into_bytes()),
            Format::Png => raster::png(&self.drawing),
            Format::Pdf => pdf::file(&self.drawing),
            Format::Html => Ok(self.html().into_bytes()),
        }
    }

    /// Writes a file in the format that its ending shows, SVG where it has none.
    ///
    /// # Errors
    /// [`WriteError`] with the path.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        write_whole(path, |out| {
            let bytes = self.bytes(Format::of(path).unwrap_or(Format::Svg)).map_err(std::io::Error::other)?;
            out.write_all(&bytes)
        })
    }
}

/// A drawing as the text of an SVG file.
#[must_use]
pub(crate) fn svg_text(drawing: &Drawing) -> String {
    svg::text(drawing)
}

/// The heading of pictures of a model.
#[must_use]
pub fn heading(setup: &Setup, note: String) -> Heading {
    let interface = setup.model().interface();
    let title = if interface.text.is_empty() { interface.name.clone() } else { format!("{}: {}", interface.name, interface.text) };
    Heading { title, note, phases: interface.phases.clone() }
}
