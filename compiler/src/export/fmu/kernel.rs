//! The sources of an FMU in one text, for many instances at once: C99, or CUDA for NVRTC.

use std::num::NonZeroU32;

use super::{HISTORY, PAST, Parts, Settings, order, partials, readers_of_steady, tables, variables};
use crate::export::{ExportError, Nominal, Origin, c, functions};
use crate::model::Model;

/// Definitions for NVRTC, which has no headers. All functions are of the device with its option
/// `--device-as-default-execution-space`.
const PRELUDE: &str = "#define SMPL_BATCH
#if defined(__CUDACC_RTC__)
#define NULL 0
#define INFINITY __builtin_bit_cast(double, 0x7ff0000000000000ull)
#define NAN __builtin_bit_cast(double, 0x7ff8000000000000ull)
#else
#include <math.h>
#include <stddef.h>
#include <string.h>
#endif
";

/// Sources that the interface of FMI needs alone are left out.
const SHARED: [&str; 6] = ["types.h", "linear.h", "core.h", "linear.c", "core.c", "solver.c"];

/// Source of a batch of instances of a model.
pub(in crate::export) fn print(
    model: &Model,
    nominal: &Nominal<'_>,
    origin: &Origin<'_>,
    settings: &Settings,
) -> Result<String, ExportError> {
    let mut sheet = functions::sheet(model, nominal)?;
    super::refuse(&sheet)?;
    let steady = readers_of_steady(&sheet);
    let timed = sheet.function("residual").is_some_and(|f| sheet.uses_time(f));
    super::add_next_break(&mut sheet)?;
    let text = c::write(&mut sheet, origin, "model")?;
    let variables = variables::Variables::new(&sheet, !steady.is_empty())?;
    let order = order::order(&text.pattern);
    let parts = Parts {
        sheet: &sheet,
        settings,
        identifier: "model",
        variables: &variables,
        partials: &partials::Partials { rows: vec![], columns: vec![], height: 0, width: 0 },
        order: &order,
        room: order::most_entries(&text.pattern, &order),
        steady: &steady,
        timed,
        history: settings.history.map_or(HISTORY[1], NonZeroU32::get),
    };
    let [header, tables] = tables::print(&parts);
    let shared = |name: &str| super::shared(&sheet).find(|(known, _)| *known == name).map_or("", |(_, text)| text);
    let [types, linear, core, linear_source, core_source, solver] = SHARED.map(shared);
    let [past, ring, breaks] = PAST.map(shared);
    let pieces =
        [&text.header, types, &header, linear, core, &text.source, &tables, linear_source, core_source, past, ring, breaks, solver, BATCH];
    let lines = pieces.iter().flat_map(|piece| piece.lines());
    // Definitions come before their uses, and CUDA has no declarations of tables.
    let kept = lines.filter(|line| !line.starts_with("#include") && !line.starts_with("extern const"));
    Ok(std::iter::once(PRELUDE.trim_end()).chain(kept).fold(String::new(), |text, line| text + line + "\n"))
}

const BATCH: &str = include_str!("sources/batch.c");
