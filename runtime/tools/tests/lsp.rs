//! The language server by a scripted client in process: a snapshot for each capability, positions in three encodings, and what a client
//! does that is wrong.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use lsp_server::{Message, Notification, Request, RequestId};
use serde_json::{Value, json};
use smpl_tools::lsp::{Session, SessionOptions};

const TANK: &str = "\
model Tank \"a tank that drains, 20 °C\"
time t : min

param  A : m^2       = 0.5               \"cross-section 😀²\"
param  k : m^2.5/min = 0.1               \"valve constant\"
param  A_2 : m^2     = 2*A               \"twice\"
action q : m^3/min   = 0.1 in 0..0.3     \"inflow\"
state  h : m         = 1   in 0..2       \"level\"
let    out           = k*sqrt(h)

eq d/dt h = (q - out) / A_2

initial h ~ uniform(0.5, 1.5)
observe h
reward setpoint default = -sq((h - 1 [m]) / 1 [m])
fail   overflow when outside bounds(h)
episode { step = 1 [min], max_steps = 50, error_reward = -100 }
";

const UNITS: &str = "\
connector Stream { Q : L/min }
component Stirred \"well mixed\" {
  param V : L \"volume\"
  port inlet, outlet : Stream
  state m : kg = 1
  eq d/dt m = -inlet.Q / V * m
  eq outlet.Q = inlet.Q
}
";

const PLANT: &str = "\
model Plant
use \"units.eq\"
time t : min
use Stirred as R1(V = 3 [L])
eq R1.inlet.Q = 1 [L/min]
observe R1.m in 0..2
episode { step = 1 [min], max_steps = 5 }
";

const SCENARIO: &str = "parameters:\n  R1.V: 4\nmax_steps: 3\n";

/// A client with its session, and a folder of files.
struct Client {
    session: Session,
    messages: Receiver<Message>,
    folder: tempfile::TempDir,
    next: i32,
    notifications: Vec<Notification>,
}

impl Client {
    fn new(files: &[(&str, &str)]) -> Client {
        Client::with(files, json!({ "general": { "positionEncodings": ["utf-16"] } }))
    }

    fn with(files: &[(&str, &str)], capabilities: Value) -> Client {
        let folder = tempfile::tempdir().expect("a folder");
        files.iter().for_each(|(name, text)| std::fs::write(folder.path().join(name), text).expect("a file"));
        let (out, messages) = channel();
        let options = SessionOptions { command: vec!["smpl".into()], book: Some("file:///book.md".into()), ..SessionOptions::default() };
        let mut client = Client { session: Session::new(out, options), messages, folder, next: 0, notifications: Vec::new() };
        let root = client.uri("");
        let params = json!({ "capabilities": capabilities, "workspaceFolders": [{ "uri": root, "name": "models" }] });
        client.request("initialize", params).expect("an answer");
        client.notify("initialized", json!({}));
        client
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn uri(&self, name: &str) -> String {
        format!("file://{}", self.path(name).display()).trim_end_matches('/').to_owned()
    }

    fn notify(&mut self, method: &str, params: Value) {
        assert!(self.session.handle(Notification { method: method.to_owned(), params }.into()));
    }

    fn request(&mut self, method: &str, params: Value) -> Result<Value, String> {
        self.next += 1;
        let id = RequestId::from(self.next);
        assert!(self.session.handle(Request { id: id.clone(), method: method.to_owned(), params }.into()));
        loop {
            match self.messages.recv_timeout(Duration::from_secs(120)).expect("an answer") {
                Message::Response(response) if response.id == id => {
                    return response.response_result.map_err(|error| error.message);
                }
                Message::Notification(notification) => self.notifications.push(notification),
                _ => {}
            }
        }
    }

    fn open(&mut self, name: &str, text: &str) {
        let uri = self.uri(name);
        let document = json!({ "uri": uri, "languageId": "smpl", "version": 1, "text": text });
        self.notify("textDocument/didOpen", json!({ "textDocument": document }));
    }

    fn change(&mut self, name: &str, version: i32, changes: Value) {
        let uri = self.uri(name);
        self.notify("textDocument/didChange", json!({ "textDocument": { "uri": uri, "version": version }, "contentChanges": changes }));
    }

    /// Diagnostics published for a version of a file.
    fn diagnostics(&mut self, name: &str, version: i32) -> Vec<Value> {
        let uri = self.uri(name);
        loop {
            let found = self
                .notifications
                .iter()
                .position(|n| n.method == "textDocument/publishDiagnostics" && n.params["uri"] == uri && n.params["version"] == version);
            if let Some(at) = found {
                return self.notifications.remove(at).params["diagnostics"].as_array().cloned().unwrap_or_default();
            }
            match self.messages.recv_timeout(Duration::from_secs(120)).expect("diagnostics") {
                Message::Notification(notification) => self.notifications.push(notification),
                other => panic!("{other:?}"),
            }
        }
    }

    /// A request about the place of a word in a text.
    fn about(&mut self, method: &str, name: &str, text: &str, word: &str, more: Value) -> Result<Value, String> {
        let mut params = json!({ "textDocument": { "uri": self.uri(name) }, "position": position(text, word) });
        merge(&mut params, more);
        self.request(method, params)
    }

    /// A request about a whole file.
    fn whole(&mut self, method: &str, name: &str, more: Value) -> Result<Value, String> {
        let mut params = json!({ "textDocument": { "uri": self.uri(name) } });
        merge(&mut params, more);
        self.request(method, params)
    }

    /// An answer without the name of the folder.
    fn shown(&self, value: &Value) -> String {
        let text = serde_json::to_string_pretty(value).expect("JSON");
        text.replace(&self.uri(""), "$")
    }
}

fn merge(params: &mut Value, more: Value) {
    if let (Value::Object(params), Value::Object(more)) = (params, more) {
        params.extend(more);
    }
}

/// The place of a word in UTF-16; `word` may hold `‸` where the place is.
fn position(text: &str, word: &str) -> Value {
    let plain = word.replace('‸', "");
    let at = text.find(&plain).unwrap_or_else(|| panic!("{plain} is not in the text")) + word.find('‸').unwrap_or(0);
    let line = text[..at].matches('\n').count();
    let start = text[..at].rfind('\n').map_or(0, |at| at + 1);
    json!({ "line": line, "character": text[start..at].encode_utf16().count() })
}

fn tank() -> Client {
    let mut client = Client::new(&[("tank.eq", TANK)]);
    client.open("tank.eq", TANK);
    assert_eq!(client.diagnostics("tank.eq", 1), Vec::<Value>::new());
    client
}

fn plant() -> Client {
    let mut client = Client::new(&[("plant.eq", PLANT), ("units.eq", UNITS), ("plant.low.yaml", SCENARIO)]);
    client.open("plant.eq", PLANT);
    assert_eq!(client.diagnostics("plant.eq", 1), Vec::<Value>::new());
    client
}

#[test]
fn hover_gives_markdown_with_the_range_of_the_word() {
    let mut client = tank();
    let state = client.about("textDocument/hover", "tank.eq", TANK, "h = (q", json!({}));
    let computed = client.about("textDocument/hover", "tank.eq", TANK, "A_2 :", json!({}));
    let unit = client.about("textDocument/hover", "tank.eq", TANK, "m^3/min", json!({}));
    let answers = [state, computed, unit].map(|answer| client.shown(&answer.expect("an answer")));
    insta::assert_snapshot!("hover", answers.join("\n"));
}

#[test]
fn completion_gives_edits_of_the_begun_word() {
    let mut client = tank();
    let answer = client.about("textDocument/completion", "tank.eq", TANK, "(q - ou‸t)", json!({})).expect("an answer");
    let items = answer["items"].as_array().expect("items");
    let short: Vec<String> = items.iter().take(12).map(|item| format!("{} — {}", item["label"], item["detail"])).collect();
    insta::assert_snapshot!("completion", format!("{}\n{}", short.join("\n"), client.shown(&items[0]["textEdit"])));
}

#[test]
fn definition_references_and_highlights_lead_across_files() {
    let mut client = plant();
    let definition = client.about("textDocument/definition", "plant.eq", PLANT, "V = 3", json!({})).expect("an answer");
    let context = json!({ "context": { "includeDeclaration": true } });
    let references = client.about("textDocument/references", "plant.eq", PLANT, "V = 3", context).expect("an answer");
    let highlights = client.about("textDocument/documentHighlight", "plant.eq", PLANT, "R1(V", json!({})).expect("an answer");
    let file = client.about("textDocument/definition", "plant.eq", PLANT, "units.eq", json!({})).expect("an answer");
    let answers = [definition, references, highlights, file].map(|answer| client.shown(&answer));
    insta::assert_snapshot!("navigation", answers.join("\n"));
}

#[test]
fn rename_edits_imports_and_scenarios_and_is_refused_with_the_reason() {
    let mut client = plant();
    let edit = client.about("textDocument/rename", "plant.eq", PLANT, "V = 3", json!({ "newName": "holdup" })).expect("an edit");
    insta::assert_snapshot!("rename", client.shown(&edit));
    let refused = client.about("textDocument/rename", "plant.eq", PLANT, "V = 3", json!({ "newName": "m" }));
    assert_eq!(refused, Err("`m` already has a meaning on line 6, which the new name would change".into()));
    assert!(client.about("textDocument/prepareRename", "plant.eq", PLANT, "observe", json!({})).is_err());
}

#[test]
fn structure_requests_answer_for_the_whole_file() {
    let mut client = tank();
    let outline = client.whole("textDocument/documentSymbol", "tank.eq", json!({})).expect("an answer");
    let names: Vec<String> = outline.as_array().expect("a list").iter().map(|s| format!("{} {}", s["name"], s["kind"])).collect();
    let folds = client.whole("textDocument/foldingRange", "tank.eq", json!({})).expect("an answer");
    let places = json!({ "positions": [position(TANK, "out) / A_2")] });
    let selection = client.whole("textDocument/selectionRange", "tank.eq", places).expect("an answer");
    let lenses = client.whole("textDocument/codeLens", "tank.eq", json!({})).expect("an answer");
    let range = json!({ "range": { "start": { "line": 0, "character": 0 }, "end": { "line": 99, "character": 0 } } });
    let hints = client.whole("textDocument/inlayHint", "tank.eq", range).expect("an answer");
    let symbols = client.request("workspace/symbol", json!({ "query": "A_" })).expect("an answer");
    let answers = [folds, selection, lenses, hints, symbols].map(|answer| client.shown(&answer));
    insta::assert_snapshot!("structure", format!("{}\n{}", names.join("\n"), answers.join("\n")));
}

#[test]
fn links_and_tokens_answer() {
    let mut client = plant();
    let links = client.whole("textDocument/documentLink", "plant.eq", json!({})).expect("an answer");
    let tokens = client.whole("textDocument/semanticTokens/full", "plant.eq", json!({})).expect("an answer");
    let first: Vec<Value> = tokens["data"].as_array().expect("numbers").iter().take(25).cloned().collect();
    insta::assert_snapshot!("links and tokens", format!("{}\n{}", client.shown(&links), Value::Array(first)));
}

#[test]
fn signature_help_names_the_active_argument() {
    let mut client = tank();
    let at = client.about("textDocument/signatureHelp", "tank.eq", TANK, "uniform(0.5, ‸1.5)", json!({})).expect("an answer");
    insta::assert_snapshot!("signature", client.shown(&at));
}

#[test]
fn formatting_edits_only_lines_that_change() {
    let messy = TANK.replace("initial h ~", "initial   h~");
    let mut client = Client::new(&[("tank.eq", &messy)]);
    client.open("tank.eq", &messy);
    let options = json!({ "options": { "tabSize": 2, "insertSpaces": true } });
    let edits = client.whole("textDocument/formatting", "tank.eq", options.clone()).expect("edits");
    let list = edits.as_array().expect("a list");
    assert!(list.iter().any(|edit| edit["newText"] == "initial h ~ uniform(0.5, 1.5)\n"), "{edits}");
    let mut part = options;
    merge(&mut part, json!({ "range": { "start": { "line": 12, "character": 0 }, "end": { "line": 12, "character": 3 } } }));
    let edits = client.whole("textDocument/rangeFormatting", "tank.eq", part).expect("edits");
    assert_eq!(edits.as_array().map(Vec::len), Some(1), "{edits}");
}

#[test]
fn diagnostics_carry_code_page_help_and_related_places() {
    let mut client = tank();
    let at = position(TANK, "out) / A_2");
    let end = json!({ "line": at["line"], "character": at["character"].as_u64().expect("a number") + 11 });
    client.change("tank.eq", 2, json!([{ "range": { "start": at, "end": end }, "text": "out)" }]));
    let found = client.diagnostics("tank.eq", 2);
    insta::assert_snapshot!("diagnostics", client.shown(&Value::Array(found)));
}

#[test]
fn only_the_newest_version_is_published_and_each_version_once() {
    let mut client = tank();
    for version in 2..40 {
        let text = if version % 2 == 0 { "h2" } else { "h" };
        let whole = TANK.replace("observe h", &format!("observe {text}"));
        client.change("tank.eq", version, json!([{ "text": whole }]));
    }
    assert_eq!(client.diagnostics("tank.eq", 39), Vec::<Value>::new());
    // What was published before belongs to one version each.
    let mut versions: Vec<i64> = client
        .notifications
        .iter()
        .filter(|n| n.method == "textDocument/publishDiagnostics")
        .filter_map(|n| n.params["version"].as_i64())
        .collect();
    let all = versions.len();
    versions.dedup();
    assert_eq!(versions.len(), all);
}

#[test]
fn conditions_at_the_start_are_judged_as_by_the_check() {
    let vessel = "time t : s\nstate N : mol = 1\nvar p : mol\neq p = 2*N\neq d/dt N = -N/1 [s]\nepisode { step = 1 [s], max_steps = 1 }\n";
    let one = format!("{vessel}initial eq p = 4 [mol]\n");
    let mut client = Client::new(&[("vessel.eq", &one)]);
    client.open("vessel.eq", &one);
    let codes = |found: Vec<Value>| found.iter().map(|d| (d["code"].clone(), d["range"]["start"]["line"].clone())).collect::<Vec<_>>();
    assert_eq!(codes(client.diagnostics("vessel.eq", 1)), [(json!("W0611-replaced-start"), json!(6))]);
    client.change("vessel.eq", 2, json!([{ "text": format!("{one}initial eq N = 3 [mol]\n") }]));
    assert_eq!(codes(client.diagnostics("vessel.eq", 2)), [(json!("E0502-overdetermined"), json!(7))]);
    client.change("vessel.eq", 3, json!([{ "text": format!("{vessel}initial eq p = 4 [mol] free N\n") }]));
    assert_eq!(client.diagnostics("vessel.eq", 3), Vec::<Value>::new());
}

#[test]
fn pulled_diagnostics_wait_for_the_newest_text() {
    let mut client = Client::with(&[("tank.eq", TANK)], json!({ "textDocument": { "diagnostic": {} } }));
    client.open("tank.eq", TANK);
    let wrong = TANK.replace("observe h", "observe h2");
    client.change("tank.eq", 2, json!([{ "text": wrong }]));
    let report = client.whole("textDocument/diagnostic", "tank.eq", json!({})).expect("a report");
    assert_eq!(report["items"][0]["code"], "E0201-unknown-name", "{report}");
    assert!(client.notifications.iter().all(|n| n.method != "textDocument/publishDiagnostics"));
}

#[test]
fn code_actions_remove_their_diagnostic() {
    let mut client = tank();
    let wrong = TANK.replace("observe h", "observe hh");
    client.change("tank.eq", 2, json!([{ "text": wrong }]));
    let found = client.diagnostics("tank.eq", 2);
    let range = found[0]["range"].clone();
    let asked = json!({ "range": range, "context": { "diagnostics": found } });
    let actions = client.whole("textDocument/codeAction", "tank.eq", asked).expect("actions");
    let first = &actions[0];
    assert_eq!((&first["title"], &first["isPreferred"]), (&json!("Replace by `h`"), &json!(true)), "{actions}");
    let edit = first["edit"]["changes"][client.uri("tank.eq")].clone();
    client.change("tank.eq", 3, json!([{ "range": edit[0]["range"], "text": edit[0]["newText"] }]));
    assert_eq!(client.diagnostics("tank.eq", 3), Vec::<Value>::new());
}

/// Before the place are 59 characters by Python's `len`; the emoji counts 4 bytes and 2 units of UTF-16, `²` 2 bytes.
#[test]
fn positions_are_right_in_all_three_encodings() {
    for (encoding, character) in [("utf-8", 63), ("utf-16", 60), ("utf-32", 59)] {
        let text = TANK.replace("😀²\"", "😀²\" wrong");
        let mut client = Client::with(&[("tank.eq", TANK)], json!({ "general": { "positionEncodings": [encoding] } }));
        client.open("tank.eq", &text);
        let found = client.diagnostics("tank.eq", 1);
        assert_eq!(found[0]["range"]["start"]["character"], character + 1, "{encoding}: {found:?}");
        // An edit at the place removes what is wrong.
        let (start, end) = (json!({ "line": 3, "character": character }), json!({ "line": 3, "character": character + 6 }));
        client.change("tank.eq", 2, json!([{ "range": { "start": start, "end": end }, "text": "" }]));
        assert_eq!(client.diagnostics("tank.eq", 2), Vec::<Value>::new(), "{encoding}");
    }
}

#[test]
fn a_library_file_is_checked_in_the_model_that_imports_it() {
    let mut client = Client::new(&[("plant.eq", PLANT), ("units.eq", UNITS)]);
    client.open("units.eq", UNITS);
    assert_eq!(client.diagnostics("units.eq", 1), Vec::<Value>::new());
    client.change("units.eq", 2, json!([{ "text": UNITS.replace("inlet.Q / V * m", "inlet.Q * m") }]));
    let found = client.diagnostics("units.eq", 2);
    assert_eq!(found[0]["code"], "E0302-unit-mismatch");
}

#[test]
fn a_part_of_a_model_without_components_is_checked_in_that_model() {
    let part = "use Stirred as R2(V = 1 [L])\nconnect R1.outlet -> R2.inlet\nepisode { step = 1 [min], max_steps = 5 }\n";
    let plant = PLANT.replace("time t", "use \"part.eq\"\ntime t").replace("episode { step = 1 [min], max_steps = 5 }\n", "");
    let mut client = Client::new(&[("plant.eq", &plant), ("units.eq", UNITS), ("part.eq", part)]);
    client.open("part.eq", part);
    assert_eq!(client.diagnostics("part.eq", 1), Vec::<Value>::new());
}

#[test]
fn a_scenario_is_checked_with_its_model() {
    let mut client = plant();
    client.open("plant.low.yaml", SCENARIO);
    assert_eq!(client.diagnostics("plant.low.yaml", 1), Vec::<Value>::new());
    client.change("plant.low.yaml", 2, json!([{ "text": "parameters:\n  R1.W: 4\n" }]));
    let found = client.diagnostics("plant.low.yaml", 2);
    assert_eq!(found.len(), 1, "{found:?}");
    let hover = client.about("textDocument/hover", "plant.low.yaml", "parameters:\n  R1.W: 4\n", "R1", json!({})).expect("an answer");
    assert!(hover["contents"]["value"].as_str().is_some_and(|text| text.contains("Stirred")), "{hover}");
}

#[test]
fn a_wrong_client_gets_errors_and_harms_nothing() {
    let mut client = tank();
    assert!(client.request("textDocument/unknown", json!({})).is_err());
    assert!(client.request("textDocument/hover", json!({ "textDocument": 5 })).is_err());
    assert!(
        client
            .request(
                "textDocument/hover",
                json!({ "textDocument": { "uri": "file:///nowhere.eq" }, "position": { "line": 0, "character": 0 } })
            )
            .is_err()
    );
    client.change("never opened.eq", 1, json!([{ "text": "x" }]));
    let far = json!({ "start": { "line": 900, "character": 900 }, "end": { "line": 3, "character": 900 } });
    client.change("tank.eq", 2, json!([{ "range": far, "text": "" }]));
    client.notify("textDocument/didChange", json!([1, 2]));
    assert!(client.about("textDocument/hover", "tank.eq", TANK, "h = (q", json!({})).is_ok());
    client.request("shutdown", Value::Null).expect("an answer");
    assert!(client.request("textDocument/hover", json!({})).is_err());
    assert!(!client.session.handle(Notification { method: "exit".into(), params: Value::Null }.into()));
}

/// Resident memory in kilobytes.
fn memory() -> Option<u64> {
    let status = std::fs::read_to_string(Path::new("/proc/self/status")).ok()?;
    status.lines().find(|line| line.starts_with("VmRSS"))?.split_whitespace().nth(1)?.parse().ok()
}

#[test]
fn memory_stays_flat_over_many_edits() {
    let mut client = tank();
    let mut version = 1;
    let mut edit = |client: &mut Client, times: usize| {
        for _ in 0..times {
            version += 1;
            let at = json!({ "line": 2, "character": 0 });
            let (end, text) = if version % 2 == 0 { (at.clone(), "# x") } else { (json!({ "line": 2, "character": 3 }), "") };
            client.change("tank.eq", version, json!([{ "range": { "start": at, "end": end }, "text": text }]));
        }
        client.diagnostics("tank.eq", version);
        client.notifications.clear();
    };
    edit(&mut client, 300);
    let before = memory();
    edit(&mut client, 1500);
    if let (Some(before), Some(after)) = (before, memory()) {
        assert!(after < before + 20_000, "{before} kB before, {after} kB after");
    }
}
