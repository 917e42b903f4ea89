//! `smpl new`: a small model to begin with.

use std::path::{Path, PathBuf};

use clap::Args;

use super::report::Failed;
use super::say;
use smpl_runtime::trajectory::write_whole;

const MODEL: &str = include_str!("new.eq");

#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  smpl new tank
  smpl new models/crystalliser.eq")]
pub(super) struct NewArguments {
    /// Name of the model, or the path of its file
    #[arg(value_name = "NAME|FILE.eq")]
    name: PathBuf,
}

/// Writes a model that runs, with comments that say what its statements are for.
pub(super) fn run(arguments: &NewArguments) -> Result<(), Failed> {
    let path = match arguments.name.extension() {
        None => arguments.name.with_extension("eq"),
        Some(ending) if ending == "eq" => arguments.name.clone(),
        Some(_) => {
            return Err(Failed::Message(format!("a model's file ends in .eq; name it {}", arguments.name.with_extension("eq").display())));
        }
    };
    if path.symlink_metadata().is_ok() {
        return Err(Failed::Message(format!("{} exists already; give another name", path.display())));
    }
    let text = MODEL.replacen("NAME", &model_name(&path), 1).replace("FILE", &path.display().to_string());
    write_whole(&path, |out| out.write_all(text.as_bytes()))?;
    let shown = path.display();
    say(format!("written: {shown}\ntry: smpl simulate {shown} --plot run.svg\n"))
}

/// A name of the language from that of a file: letters, digits and underscores, a letter first.
fn model_name(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let mut name = String::new();
    for part in stem.split(|c: char| !c.is_ascii_alphanumeric()).filter(|part| !part.is_empty()) {
        let (first, rest) = part.split_at(1);
        name.push_str(&first.to_ascii_uppercase());
        name.push_str(rest);
    }
    if name.starts_with(|c: char| c.is_ascii_alphabetic()) { name } else { format!("Model{name}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_is_named_after_its_file() {
        for (path, name) in [("tank", "Tank"), ("a/two-tanks.eq", "TwoTanks"), ("2nd_try.eq", "Model2ndTry"), ("\u{e9}.eq", "Model")] {
            assert_eq!(model_name(Path::new(path)), name);
        }
    }
}
