//! Code lenses, and the commands that they run: `smpl simulate`, `smpl steady` and `smpl live` on
//! the saved file.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::str::FromStr;
use std::sync::Arc;

use lsp_server::{ErrorCode, Request, RequestId};
use lsp_types::{CodeLensParams, ExecuteCommandParams, Uri};
use serde_json::{Value, json};
use smpl_dsl::syntax::StatementKind;

use super::convert::{path_of, uri_of};
use super::session::{Answer, Session, answer, is_scenario};
use super::worker::Shared;

/// Commands with their titles.
const LENSES: &[(&str, &str)] = &[("smpl.simulate", "simulate"), ("smpl.steady", "steady state"), ("smpl.live", "open live page")];

impl Session {
    pub(super) fn lenses(&mut self, params: CodeLensParams) -> Answer {
        let uri = &params.text_document.uri;
        if !self.settings.lenses || self.options.command.is_empty() || is_scenario(&path_of(uri)) {
            return answer(Value::Null);
        }
        let at = self.at(uri)?;
        let statements = &at.program.files[usize::from(at.file.0)].tree.statements;
        let model = statements.iter().find(|s| matches!(s.kind, StatementKind::Model { .. } | StatementKind::Time { .. }));
        let Some(model) = model.filter(|_| at.file.0 == 0) else { return answer(Value::Null) };
        let range = at.places().range(&(model.span.start as usize..model.span.end as usize));
        let lens = |(command, title): &(&str, &str)| json!({ "range": range, "command": { "title": title, "command": command, "arguments": [uri] } });
        answer(LENSES.iter().map(lens).collect::<Vec<_>>())
    }

    pub(super) fn execute(&mut self, params: ExecuteCommandParams) -> Answer {
        let unknown = || (ErrorCode::InvalidParams, format!("unknown command `{}`", params.command));
        let name = params.command.strip_prefix("smpl.").ok_or_else(unknown)?;
        let uri = params.arguments.first().and_then(Value::as_str).and_then(|text| Uri::from_str(text).ok());
        let path = uri.map(|uri| path_of(&uri)).filter(|path| path.is_file());
        let path = path.ok_or_else(|| (ErrorCode::InvalidParams, "the command needs the address of a saved model".to_owned()))?;
        let [program, first @ ..] = self.options.command.as_slice() else { return Err(unknown()) };
        let mut command = Command::new(program);
        command.args(first).stdin(Stdio::null()).stderr(Stdio::piped()).stdout(Stdio::piped());
        let run = Run { shared: Arc::clone(&self.worker.shared), shows: self.shows_documents };
        match name {
            "simulate" => {
                let picture = result_of(&path, "svg");
                command.arg("simulate").arg(&path).arg("--plot").arg(&picture);
                std::thread::spawn(move || run.finish(command, Some(picture)));
            }
            "steady" => {
                command.arg("steady").arg(&path);
                std::thread::spawn(move || run.finish(command, None));
            }
            "live" => {
                command.arg("live").arg(&path).arg("--no-open");
                std::thread::spawn(move || run.page(command));
            }
            _ => return Err(unknown()),
        }
        answer(Value::Null)
    }
}

/// The file that a command writes, outside of the model's folder.
fn result_of(model: &Path, extension: &str) -> PathBuf {
    let stem = model.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    std::env::temp_dir().join(format!("smpl-{}-{stem}.{extension}", std::process::id()))
}

/// A command in progress.
struct Run {
    shared: Arc<Shared>,
    shows: bool,
}

impl Run {
    fn say(&self, kind: u32, message: &str) {
        self.shared.notify("window/showMessage", json!({ "type": kind, "message": message.trim() }));
    }

    fn show(&self, uri: &str, external: bool) {
        if self.shows {
            let id = RequestId::from(format!("smpl-show-{uri}"));
            let params = json!({ "uri": uri, "external": external });
            self.shared.send(Request { id, method: "window/showDocument".into(), params });
        } else {
            self.say(3, uri);
        }
    }

    /// Waits for a command and shows its file, else what it has printed.
    fn finish(&self, mut command: Command, file: Option<PathBuf>) {
        match command.output() {
            Err(error) => self.say(1, &format!("cannot run smpl: {error}")),
            Ok(output) if !output.status.success() => self.say(1, &String::from_utf8_lossy(&output.stderr)),
            Ok(output) => match file.and_then(|file| uri_of(&file)) {
                Some(uri) => self.show(uri.as_str(), false),
                None => self.say(3, &String::from_utf8_lossy(&output.stdout)),
            },
        }
    }

    /// Starts a live page and shows its address, which is the first line that it prints.
    fn page(&self, mut command: Command) {
        let mut child = match command.stderr(Stdio::null()).spawn() {
            Ok(child) => child,
            Err(error) => return self.say(1, &format!("cannot run smpl: {error}")),
        };
        let mut line = String::new();
        if let Some(out) = child.stdout.take() {
            let _ = BufReader::new(out).read_line(&mut line);
        }
        match line.trim() {
            "" => self.say(1, "`smpl live` did not start"),
            address => self.show(address, true),
        }
        let _ = child.wait();
    }
}
