//! `smpl live` over its sockets, as a page uses it.

mod client;

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

use client::{Folder, Live, Page, column, command, curve, status_of, uri};
use serde_json::{Value, json};

/// x' = u - k x with x(0) = 2: x(t) = u/k + (2 - u/k) exp(-k t).
const DECAY: &str = "model Decay \"a decay\"\ntime t : s\nparam k : 1/s = 0.5 in 0..4 \"rate\"\nparam c : 1/s = 1\n\
                     state x : m = 2 in 0..10 \"level\"\naction u : m/s = 0 in 0..5\neq d/dt x = u - k*x\nobserve x\n\
                     reward r default = -x/1 [m]\nconstraint high when x > 1 [m]\nepisode { step = 1 [s], max_steps = 8 }\n";

/// Takes seconds: a million steps.
const LONG: &str = "model Long\ntime t : s\nparam k : 1/s = 0.5\nstate x = 1\neq d/dt x = -k*x*(1 + sin(t/1 [s]))\n\
                    reward r default = x\nepisode { step = 1 [s], max_steps = 1000000 }\n";

fn live(folder: &Folder) -> Live {
    Live::start(&[folder.path().to_str().expect("utf-8")])
}

fn close(got: &[f64], wanted: impl Iterator<Item = f64>) {
    let wanted: Vec<f64> = wanted.collect();
    assert_eq!(got.len(), wanted.len());
    for (got, wanted) in got.iter().zip(wanted) {
        assert!((got - wanted).abs() < 1e-5 * (1.0 + wanted.abs()), "{got} is not {wanted}");
    }
}

/// x(t) of [`DECAY`].
fn decay(k: f64, u: f64, times: &[f64]) -> impl Iterator<Item = f64> {
    times.iter().map(move |t| u / k + (2.0 - u / k) * (-k * t).exp())
}

#[test]
fn the_first_line_is_the_address_and_only_the_page_itself_is_let_in() {
    let folder = Folder::new();
    let file = folder.write("decay.eq", DECAY);
    let live = Live::start(&[file.to_str().expect("utf-8")]);
    assert!(live.token.len() >= 32);
    let (token, host) = (live.token.clone(), live.host());
    let answer = live.request(&format!("GET /{token}/ HTTP/1.1\r\n{host}"));
    assert!(status_of(&answer) == 200 && answer.contains("live.js"), "{answer}");
    let policy = answer.lines().find(|line| line.starts_with("Content-Security-Policy")).expect("a policy");
    assert!(policy.contains("default-src 'none'") && !policy.contains("http:") && !policy.contains('*'), "{policy}");
    assert_eq!(live.status(&format!("GET /{token}/live.js HTTP/1.1\r\n{host}")), 200);
    let elsewhere = format!("Host: 127.0.0.1:{}", live.port.wrapping_add(1));
    for (head, status) in [
        (format!("GET / HTTP/1.1\r\n{host}"), 404),
        (format!("GET /{}/ HTTP/1.1\r\n{host}", "0".repeat(token.len())), 404),
        (format!("GET /{token}/ HTTP/1.1\r\nHost: evil.example"), 403),
        (format!("GET /{token}/ HTTP/1.1\r\n{elsewhere}"), 403),
        (format!("GET /{token}/ws HTTP/1.1\r\n{host}\r\nOrigin: http://evil.example\r\nUpgrade: websocket"), 403),
        (format!("GET /{token}/../Cargo.toml HTTP/1.1\r\n{host}"), 404),
        (format!("GET /{token}/%2e%2e/state HTTP/1.1\r\n{host}"), 404),
        (format!("GET /{token}//etc/passwd HTTP/1.1\r\n{host}"), 404),
        (format!("POST /{token}/ HTTP/1.1\r\n{host}"), 405),
        ("nonsense".into(), 400),
        (format!("GET /{token}/ HTTP/1.1\r\n{host}\r\nX: {}", "x".repeat(20_000)), 431),
    ] {
        assert_eq!(live.status(&head), status, "{}", &head[..head.len().min(200)]);
    }
    let files = live.page().result("smpl/files", json!({}));
    assert_eq!(files["open"], uri(&file));
    assert_eq!(files["files"][0]["title"], "Decay: a decay");
}

#[test]
fn curves_follow_the_text_and_the_controls() {
    let folder = Folder::new();
    let file = folder.write("decay.eq", DECAY);
    let live = live(&folder);
    let mut page = live.page();
    let read = page.result("smpl/read", json!({"uri": uri(&file)}));
    assert_eq!(read["text"], DECAY);
    let name = page.open(&file, DECAY);
    let answer = page.run(&name, json!({}));
    let (times, values) = column(&answer["runs"][0], "x");
    assert!(times.len() > 300 && answer["stale"] == false);
    close(&values, decay(0.5, 0.0, &times));
    // Every control moves the curve.
    for (settings, k, u) in [
        (json!({"parameters": {"k": 2}}), 2.0, 0.0),
        (json!({"actions": {"u": 3}}), 0.5, 3.0),
        (json!({"parameters": {"k": 1}, "actions": {"u": 1}, "method": "explicit", "rtol": 1e-9}), 1.0, 1.0),
    ] {
        let run = &page.run(&name, settings)["runs"][0];
        let (times, values) = column(run, "x");
        close(&values, decay(k, u, &times));
    }
    let run = &page.run(&name, json!({"initial": {"x": 4}, "steps": 2}))["runs"][0];
    let (times, values) = column(run, "x");
    close(&values, times.iter().map(|t| 4.0 * (-0.5 * t).exp()));
    assert_eq!(run["end"]["kind"], "time_limit");
    assert_eq!(curve(&run["grids"]["step"]), [0.0, 1.0, 2.0]);
    // Another text.
    page.change(&name, 2, &DECAY.replace("k*x", "2*k*x"));
    let run = &page.run(&name, json!({}))["runs"][0];
    let (times, values) = column(run, "x");
    close(&values, decay(1.0, 0.0, &times));
    let rewards = curve(&run["rewards"][0]["values"]);
    close(&rewards[1..], (1..=8).map(|t| -2.0 * f64::from(-t).exp()));
}

#[test]
fn diagnostics_follow_every_change() {
    let folder = Folder::new();
    let file = folder.write("decay.eq", DECAY);
    let live = live(&folder);
    let mut page = live.page();
    let answer = page.result("initialize", json!({"capabilities": {}, "workspaceFolders": [{"uri": "file:///", "name": "all"}]}));
    assert_eq!(answer["capabilities"]["hoverProvider"], true);
    page.notify("initialized", json!({}));
    let name = page.open(&file, DECAY);
    let published = |version: i32| {
        move |message: &Value| message["method"] == "textDocument/publishDiagnostics" && message["params"]["version"] == version
    };
    let errors = |message: &Value| {
        let all = message["params"]["diagnostics"].as_array().expect("diagnostics").clone();
        all.into_iter().filter(|d| d["severity"] == 1).collect::<Vec<Value>>()
    };
    assert!(errors(&page.wait("diagnostics", published(1))).is_empty());
    page.change(&name, 2, &DECAY.replace("u - k*x", "u - k"));
    let found = errors(&page.wait("diagnostics", published(2)));
    assert_eq!((found.len(), &found[0]["code"], &found[0]["range"]["start"]["line"]), (1, &json!("E0302-unit-mismatch"), &json!(6)));
    page.change(&name, 3, DECAY);
    assert!(errors(&page.wait("diagnostics", published(3))).is_empty());
    let hover = page.result("textDocument/hover", json!({"textDocument": {"uri": name}, "position": {"line": 2, "character": 6}}));
    assert!(hover["contents"]["value"].as_str().is_some_and(|text| text.contains("rate")), "{hover}");
    // Files outside of the folder are not available to the language server.
    let outside = json!({"textDocument": {"uri": "file:///etc/hosts.eq"}, "position": {"line": 0, "character": 0}});
    assert_eq!(page.call("textDocument/hover", outside).expect_err("outside").0, 4);
}

#[test]
fn sweeps_and_seeds_are_several_runs() {
    let folder = Folder::new();
    let file = folder.write("decay.eq", DECAY.replace("observe", "initial x ~ uniform(1, 3)\nobserve"));
    let live = live(&folder);
    let mut page = live.page();
    let answer = page.run(&uri(&file), json!({"sweep": {"name": "k", "values": [0.5, 1, 2]}, "start": "nominal"}));
    let runs = answer["runs"].as_array().expect("runs");
    assert_eq!(runs.len(), 3);
    for (run, k) in runs.iter().zip([0.5, 1.0, 2.0]) {
        let (times, values) = column(run, "x");
        close(&values, decay(k, 0.0, &times));
    }
    let seeds = page.run(&uri(&file), json!({"seed": 3, "seeds": 4}));
    let single = page.run(&uri(&file), json!({"seed": 5}));
    assert_eq!(seeds["runs"].as_array().map(Vec::len), Some(4));
    assert_eq!(column(&seeds["runs"][2], "x"), column(&single["runs"][0], "x"));
    assert_ne!(column(&seeds["runs"][1], "x"), column(&single["runs"][0], "x"));
}

#[test]
fn the_last_valid_text_stays_while_the_text_is_faulty() {
    let folder = Folder::new();
    let file = folder.write("decay.eq", DECAY);
    let live = live(&folder);
    let mut page = live.page();
    let never = page.open(&folder.path().join("new.eq"), "model A\neq d/dt x = y\n");
    let (code, message) = page.call("smpl/run", json!({"uri": never, "settings": {}})).expect_err("never valid");
    assert_eq!(code, 2, "{message}");
    let name = page.open(&file, DECAY);
    assert_eq!(page.result("smpl/model", json!({"uri": name}))["stale"], false);
    page.change(&name, 2, &DECAY.replace("= u - k*x", "= u - k*"));
    let model = page.result("smpl/model", json!({"uri": name}));
    assert_eq!((&model["stale"], &model["parameters"][0]["name"]), (&json!(true), &json!("k")));
    let answer = page.run(&name, json!({"parameters": {"k": 1}}));
    assert_eq!(answer["stale"], true);
    let (times, values) = column(&answer["runs"][0], "x");
    close(&values, decay(1.0, 0.0, &times));
    page.change(&name, 3, DECAY);
    assert_eq!(page.run(&name, json!({}))["stale"], false);
}

#[test]
fn controls_have_values_bounds_units_and_places() {
    let folder = Folder::new();
    let file = folder.write("decay.eq", DECAY);
    folder.write("decay.fast.yaml", "parameters: {k: 3}\n");
    let live = live(&folder);
    let mut page = live.page();
    let model = page.result("smpl/model", json!({"uri": uri(&file)}));
    let k = &model["parameters"][0];
    assert_eq!(
        (&k["name"], &k["unit"], &k["value"], &k["low"], &k["high"]),
        (&json!("k"), &json!("1/s"), &json!(0.5), &json!(0.0), &json!(4.0))
    );
    assert_eq!((&k["slider"]["low"], &k["slider"]["high"]), (&json!(0.0), &json!(4.0)));
    assert_eq!(k["range"]["start"]["line"], 2);
    // No bounds: half of the value around it.
    assert_eq!(model["parameters"][1]["slider"]["low"], 0.5);
    assert_eq!(model["scenarios"], json!(["default", "fast"]));
    assert_eq!(model["methods"], json!(["ida", "rosenbrock", "explicit", "auto"]));
    assert_eq!(model["policies"], json!(["nominal", "random"]));
    let fast = page.result("smpl/model", json!({"uri": uri(&file), "settings": {"scenario": "fast"}}));
    assert_eq!(fast["parameters"][0]["value"], 3.0);
    let (code, message) = page.call("smpl/model", json!({"uri": uri(&file), "settings": {"scenario": "../x"}})).expect_err("unknown");
    assert!(code == 3 && message.contains("unknown scenario"), "{message}");
    let panels = model["panels"].as_array().expect("panels");
    let x = panels.iter().find(|panel| panel["title"] == "x").expect("a panel of x");
    assert_eq!((&x["unit"], &x["low"], &x["high"], &x["first"]), (&json!("m"), &json!(0.0), &json!(10.0), &json!(true)));
    let columns: Vec<&str> = x["lines"].as_array().expect("lines").iter().filter_map(|line| line["column"].as_str()).collect();
    assert_eq!(columns, ["x"]);
    // Readings that differ from their quantity have their own curve.
    let noisy = page.open(&file, &DECAY.replace("observe x", "observe x noise normal(0, 0.1)"));
    let model = page.result("smpl/model", json!({"uri": noisy}));
    let lines = &model["panels"].as_array().expect("panels").iter().find(|panel| panel["title"] == "x").expect("a panel of x")["lines"];
    assert_eq!((&lines[1]["column"], &lines[1]["style"]), (&json!("obs.x"), &json!("dots")));
}

#[test]
fn instances_share_a_panel_and_fields_have_their_place() {
    const PLANT: &str = "model Plant\ntime t : s\ncomponent Tank \"a tank\" {\n  state h : m = 1 in 0..4\n  eq d/dt h = -h/2 [s]\n}\n\
                         use Tank as A, B\ndomain z in 0..1 [m] cells 10\nstate T[z] : K = 300\neq d/dt T[z] = (310 [K] - T[z])/1 [s] for z\n\
                         episode { step = 1 [s], max_steps = 4 }\n";
    let folder = Folder::new();
    let file = folder.write("plant.eq", PLANT);
    let live = live(&folder);
    let mut page = live.page();
    let model = page.result("smpl/model", json!({"uri": uri(&file)}));
    let panels = model["panels"].as_array().expect("panels");
    let tanks = panels.iter().find(|panel| panel["title"] == "h").expect("a panel for both");
    assert_eq!(tanks["lines"].as_array().map(Vec::len), Some(2));
    assert_eq!((&model["fields"][0]["name"], &model["fields"][0]["cells"]), (&json!("T"), &json!(10)));
    assert_eq!(model["fields"][0]["space"]["faces"][10], 1.0);
    // T = 310 - 10 exp(-t) in each cell.
    let run = &page.run(&uri(&file), json!({}))["runs"][0];
    let field = &run["fields"][0];
    let times = curve(&field["times"]);
    assert_eq!(times, [0.0, 1.0, 2.0, 3.0, 4.0]);
    let wanted = times.iter().flat_map(|t| std::iter::repeat_n(310.0 - 10.0 * (-t).exp(), 10));
    close(&curve(&field["values"]), wanted);
    let (times, heights) = column(run, "B.h");
    close(&heights, times.iter().map(|t| (-t / 2.0).exp()));
}

#[test]
fn a_newer_run_overtakes_an_older_one_and_a_cancelled_run_ends() {
    let folder = Folder::new();
    let file = folder.write("long.eq", LONG);
    let live = live(&folder);
    let mut page = live.page();
    let name = uri(&file);
    let first = page.ask("smpl/run", json!({"uri": name, "settings": {}}));
    let second = page.ask("smpl/run", json!({"uri": name, "settings": {}}));
    let third = page.ask("smpl/run", json!({"uri": name, "settings": {"steps": 3}}));
    assert_eq!(page.answer(second).expect_err("overtaken").0, -32801);
    assert_eq!(page.answer(first).expect_err("overtaken").0, -32801);
    assert!(page.answer(third).is_ok());
    let begin = Instant::now();
    let long = page.ask("smpl/run", json!({"uri": name, "settings": {}}));
    let progress = page.wait("progress", |message| message["method"] == "smpl/progress" && message["params"]["id"] == long);
    assert_eq!(progress["params"]["total"], 1_000_000);
    assert!(progress["params"]["done"].as_u64() < Some(1_000_000));
    // Another channel waits its turn, and descriptions do not wait at all.
    assert!(page.call("smpl/model", json!({"uri": name})).is_ok());
    page.notify("$/cancelRequest", json!({"id": long}));
    assert_eq!(page.answer(long).expect_err("cancelled").0, -32800);
    assert!(begin.elapsed() < Duration::from_secs(20));
    assert!(page.call("smpl/run", json!({"uri": name, "settings": {"steps": 3}})).is_ok());
}

#[test]
fn texts_are_saved_whole_and_never_over_the_changes_of_others() {
    let folder = Folder::new();
    let file = folder.write("decay.eq", DECAY);
    let live = live(&folder);
    let mut page = live.page();
    let name = page.open(&file, DECAY);
    let digest = page.result("smpl/read", json!({"uri": name}))["digest"].clone();
    let saved = page.result("smpl/save", json!({"uri": name, "text": "# 1\n", "digest": digest}));
    assert_eq!(std::fs::read_to_string(&file).expect("a file"), "# 1\n");
    // The page knows an older version.
    let (code, _) = page.call("smpl/save", json!({"uri": name, "text": "# 2\n", "digest": digest})).expect_err("conflict");
    assert_eq!(code, 1);
    std::thread::sleep(Duration::from_millis(20));
    std::fs::write(&file, "# by another\n").expect("written");
    let changed = page.wait("change", |message| message["method"] == "smpl/changed");
    assert_eq!((&changed["params"]["uri"], &changed["params"]["text"]), (&json!(name), &json!("# by another\n")));
    let (code, _) = page.call("smpl/save", json!({"uri": name, "text": "# 3\n", "digest": saved["digest"]})).expect_err("conflict");
    assert_eq!(code, 1);
    let forced = json!({"uri": name, "text": "# 4\n", "digest": saved["digest"], "force": true});
    assert!(page.call("smpl/save", forced).is_ok());
    // A new file is not there yet.
    let new = uri(&folder.path().join("new.eq"));
    assert!(page.call("smpl/save", json!({"uri": new, "text": "# new\n", "digest": null})).is_ok());
    assert_eq!(page.call("smpl/save", json!({"uri": new, "text": "# 2\n", "digest": null})).expect_err("there").0, 1);
    assert!(std::fs::read_dir(folder.path()).expect("a folder").flatten().all(|e| !e.file_name().to_string_lossy().ends_with(".part")));
}

#[test]
fn nothing_outside_of_the_folder_is_read_or_written() {
    let (outside, folder) = (Folder::new(), Folder::new());
    let secret = outside.write("secret.eq", "# secret\n");
    folder.write("decay.eq", DECAY);
    folder.write("notes.txt", "private");
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&secret, folder.path().join("link.eq")).expect("a link");
        std::os::unix::fs::symlink(outside.path(), folder.path().join("inner")).expect("a link");
        std::os::unix::fs::symlink(outside.path().join("later.eq"), folder.path().join("dangling.eq")).expect("a link");
    }
    let live = live(&folder);
    let mut page = live.page();
    let root = folder.path();
    let paths = [
        uri(&secret),
        format!("file://{}/../{}/secret.eq", root.display(), outside.path().file_name().expect("a name").display()),
        uri(&root.join("link.eq")),
        uri(&root.join("inner/secret.eq")),
        uri(&root.join("inner/new.eq")),
        uri(&root.join("dangling.eq")),
        uri(&root.join("notes.txt")),
        "file:///etc/passwd".into(),
        "http://127.0.0.1/x.eq".into(),
        "relative.eq".into(),
    ];
    for name in paths {
        assert_eq!(page.call("smpl/read", json!({"uri": name})).expect_err(&name).0, 4, "{name}");
        let save = json!({"uri": name, "text": "# mine\n", "digest": null, "force": true});
        assert_eq!(page.call("smpl/save", save).expect_err(&name).0, 4, "{name}");
        assert_eq!(page.call("smpl/run", json!({"uri": name, "settings": {}})).expect_err(&name).0, 4, "{name}");
    }
    assert_eq!(std::fs::read_to_string(&secret).expect("a file"), "# secret\n");
    assert!(!outside.path().join("later.eq").exists() && !outside.path().join("new.eq").exists());
    // A model cannot import it either.
    let thief = page.open(&root.join("thief.eq"), &format!("use \"{}\"\n{DECAY}", secret.display()));
    assert!(page.call("smpl/model", json!({"uri": thief})).is_err());
}

#[test]
fn the_library_can_be_read_and_not_written() {
    let (library, folder) = (Folder::new(), Folder::new());
    let shipped = library.write("decay.eq", DECAY);
    let live = Live::start_with(&[folder.path().to_str().expect("utf-8")], |command| {
        folder.write("mine.eq", DECAY);
        command.env("SMPL_LIBRARY", library.path());
    });
    let mut page = live.page();
    let files = page.result("smpl/files", json!({}));
    assert_eq!((&files["models"][0]["name"], &files["models"][0]["uri"]), (&json!("decay"), &json!(uri(&shipped))));
    assert_eq!(page.result("smpl/read", json!({"uri": uri(&shipped)}))["read_only"], true);
    assert!(page.call("smpl/run", json!({"uri": uri(&shipped), "settings": {}})).is_ok());
    let save = json!({"uri": uri(&shipped), "text": "#\n", "digest": null, "force": true});
    assert_eq!(page.call("smpl/save", save).expect_err("read only").0, 4);
}

#[test]
fn two_pages_on_one_file_have_texts_of_their_own() {
    let folder = Folder::new();
    let file = folder.write("decay.eq", DECAY);
    let live = live(&folder);
    let (mut one, mut two) = (live.page(), live.page());
    let name = one.open(&file, &DECAY.replace("= 0.5 in", "= 1 in"));
    two.open(&file, &DECAY.replace("= 0.5 in", "= 2 in"));
    for (page, k) in [(&mut one, 1.0), (&mut two, 2.0)] {
        let run = &page.run(&name, json!({}))["runs"][0];
        let (times, values) = column(run, "x");
        close(&values, decay(k, 0.0, &times));
    }
    let digest = one.result("smpl/read", json!({"uri": name}))["digest"].clone();
    one.result("smpl/save", json!({"uri": name, "text": "# one\n", "digest": digest}));
    assert_eq!(two.call("smpl/save", json!({"uri": name, "text": "# two\n", "digest": digest})).expect_err("conflict").0, 1);
    assert_eq!(two.wait("change", |message| message["method"] == "smpl/changed")["params"]["text"], "# one\n");
}

#[test]
fn nonsense_and_floods_harm_nobody() {
    let folder = Folder::new();
    let file = folder.write("decay.eq", DECAY);
    let live = live(&folder);
    let mut good = live.page();
    // Frames that are not messages.
    let mut bad = live.page();
    for i in 0..200 {
        let text = ["{", "null", "[]", "{\"id\": {}}", "\u{fffd}"][i % 5];
        if bad.socket.send(tungstenite::Message::text(text)).is_err() {
            break;
        }
    }
    // Bytes that are not frames.
    let mut raw = live.page();
    let _ = raw.socket.get_mut().write_all(&[0xff; 4096]);
    // A frame that announces more than the limit.
    let mut large = live.page();
    let _ = large.socket.get_mut().write_all(&[0x81, 0xff, 0, 0, 0, 1, 0, 0, 0, 0, 1, 2, 3, 4]);
    // Half a head, and nothing at all.
    let mut half = TcpStream::connect(("127.0.0.1", live.port)).expect("a connection");
    half.write_all(b"GET / HTT").expect("written");
    let _silent = TcpStream::connect(("127.0.0.1", live.port)).expect("a connection");
    // Wrong parameters of every request, and more requests than wait.
    let methods = ["smpl/run", "smpl/model", "smpl/read", "smpl/save", "smpl/steady", "smpl/structure", "smpl/equations", "smpl/export"];
    for method in methods {
        for params in [json!(null), json!({}), json!({"uri": 3}), json!([1, 2]), json!({"uri": uri(&file), "settings": {"seed": "x"}})] {
            if method == "smpl/read" || method == "smpl/equations" || method == "smpl/structure" || method == "smpl/model" {
                let _ = good.call(method, params);
            } else {
                let (code, message) = good.call(method, params.clone()).expect_err(method);
                assert_eq!(code, -32602, "{method} {params}: {message}");
            }
        }
    }
    assert_eq!(good.call("smpl/nothing", json!({})).expect_err("unknown").0, -32601);
    let ids: Vec<i32> =
        (0..300).map(|i| good.ask("smpl/run", json!({"uri": uri(&file), "settings": {}, "channel": format!("{i}")}))).collect();
    let answers: Vec<bool> = ids.into_iter().map(|id| good.answer(id).is_ok()).collect();
    assert!(answers.contains(&true));
    // Values that no model takes.
    for settings in [
        json!({"parameters": {"k": 1e300}}),
        json!({"parameters": {"nothing": 1}}),
        json!({"actions": {"nothing": 1}}),
        json!({"initial": {"nothing": 1}}),
        json!({"steps": 0}),
        json!({"steps": 4_000_000_000_u32}),
        json!({"seeds": 4_000_000_000_u32}),
        json!({"method": "magic"}),
        json!({"rtol": -1}),
        json!({"policy": "nothing"}),
        json!({"sweep": {"name": "nothing", "values": [1]}}),
        json!({"sweep": {"name": "k", "values": []}}),
        json!({"pid": {"measured": "nothing", "action": "u", "gain": 1}}),
        json!({"variants": ["nothing"]}),
    ] {
        let (code, message) = good.call("smpl/run", json!({"uri": uri(&file), "settings": settings})).expect_err("refused");
        assert!([2, 3].contains(&code) && !message.is_empty() && !message.contains("internal"), "{settings}: {code} {message}");
    }
    assert!(good.call("smpl/run", json!({"uri": uri(&file), "settings": {}})).is_ok());
}

#[test]
fn a_page_too_many_is_refused_until_another_closes() {
    let folder = Folder::new();
    folder.write("decay.eq", DECAY);
    let live = live(&folder);
    let mut pages: Vec<Page> = (0..16).map(|_| live.page()).collect();
    assert_eq!(live.try_page().err(), Some(503));
    let mut last = pages.pop().expect("a page");
    last.socket.close(None).expect("closed");
    let begin = Instant::now();
    while live.try_page().is_err() {
        assert!(begin.elapsed() < Duration::from_secs(10));
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn closing_the_page_ends_its_work() {
    let folder = Folder::new();
    let file = folder.write("long.eq", LONG);
    let live = live(&folder);
    let pages: Vec<Page> = (0..16)
        .map(|_| {
            let mut page = live.page();
            page.ask("smpl/run", json!({"uri": uri(&file), "settings": {}}));
            page
        })
        .collect();
    std::thread::sleep(Duration::from_millis(300));
    drop(pages);
    // Every place is free again long before a run would have ended.
    let begin = Instant::now();
    let mut free = Vec::new();
    while free.len() < 16 {
        free.extend(live.try_page().ok());
        assert!(begin.elapsed() < Duration::from_secs(20), "{} places are free", free.len());
    }
}

#[test]
fn a_loop_acts_as_the_same_law_written_down_here() {
    let folder = Folder::new();
    let file = folder.write("decay.eq", DECAY);
    let live = live(&folder);
    let mut page = live.page();
    let pid = json!({"measured": "obs.x", "action": "u", "gain": 0.8, "integral_time": 3, "derivative_time": 0.4, "set_point": 3});
    let run = &page.run(&uri(&file), json!({"pid": pid}))["runs"][0];
    let (_, actions) = column(run, "u");
    // x' = u - k x over a step of 1 s with a constant u; positional form, back calculation with the root of T_i T_d, N = 10.
    let (mut x, mut integral, mut derivative, mut last) = (2.0_f64, 0.0_f64, 0.0_f64, 2.0_f64);
    let decay = (-0.5_f64).exp();
    let wanted = (0..8).map(|_| {
        let error = 3.0 - x;
        derivative = (0.4 * derivative - 0.8 * 0.4 * 10.0 * (x - last)) / (0.4 + 10.0);
        last = x;
        let free = 0.8 * error + integral + derivative;
        let action = free.clamp(0.0, 5.0);
        integral += 0.8 / 3.0 * error + (action - free) / 1.2_f64.sqrt().max(1.0);
        x = x * decay + action / 0.5 * (1.0 - decay);
        action
    });
    close(&actions[1..], wanted);
    assert_eq!(run["set_point"], 3.0);
}

#[test]
fn the_steady_state_has_its_values_and_eigenvalues() {
    let folder = Folder::new();
    let file = folder.write("decay.eq", DECAY);
    let live = live(&folder);
    let mut page = live.page();
    let steady = page.result("smpl/steady", json!({"uri": uri(&file), "settings": {"actions": {"u": 3}, "parameters": {"k": 2}}}));
    assert_eq!(steady["found"], true);
    let x = steady["values"].as_array().expect("values").iter().find(|value| value["name"] == "x").expect("x");
    close(&[x["value"].as_f64().expect("a number")], [1.5].into_iter());
    close(&[steady["eigenvalues"][0]["re"].as_f64().expect("a number")], [-2.0].into_iter());
    let free = folder.write("free.eq", "model Free\ntime t : s\nstate x = 1\nstate y = 1\neq d/dt x = 0*x/1 [s]\neq d/dt y = -y/1 [s]\n");
    let steady = page.result("smpl/steady", json!({"uri": uri(&free), "settings": {}}));
    assert_eq!((&steady["found"], &steady["free"][0]["name"]), (&json!(false), &json!("x")), "{steady}");
    let steady = page.result("smpl/steady", json!({"uri": uri(&free), "settings": {}, "fixed": {"x": 3}}));
    assert_eq!((&steady["found"], &steady["values"][0]["value"]), (&json!(true), &json!(3.0)));
}

#[test]
fn equations_and_structure_have_places_in_the_text() {
    let folder = Folder::new();
    let text = "model A\ntime t : s\nstate x = 1\nvar y\nvar z\neq d/dt x = -y/1 [s]\neq y + z = x\neq y*z = x\n";
    let file = folder.write("a.eq", text);
    let live = live(&folder);
    let mut page = live.page();
    let name = uri(&file);
    let equations = page.result("smpl/equations", json!({"uri": name}));
    assert_eq!(equations["equations"].as_array().map(Vec::len), Some(3));
    assert_eq!(equations["equations"][1]["range"]["start"], json!({"line": 6, "character": 0}));
    assert_eq!(equations["equations"][1]["text"], "eq y + z = x");
    let structure = page.result("smpl/structure", json!({"uri": name}));
    assert_eq!((&structure["states"][0]["name"], &structure["method"]), (&json!("x"), &json!("ida")));
    assert_eq!((&structure["equations"][0]["line"], &structure["equations"][0]["uri"]), (&json!(6), &json!(name)));
    assert_eq!(structure["blocks"], json!([{"size": 2, "unknowns": ["y", "z"]}]));
    let unknowns: Vec<&str> = structure["equations"].as_array().expect("equations").iter().filter_map(|e| e["unknown"].as_str()).collect();
    assert_eq!(unknowns.len(), 3);
}

#[test]
fn what_is_exported_reproduces_the_run() {
    let folder = Folder::new();
    let file = folder.write("decay.eq", DECAY);
    let live = live(&folder);
    let mut page = live.page();
    let settings = json!({"parameters": {"k": 1}, "initial": {"x": 3}, "steps": 4, "seed": 7});
    let mut export = |format: &str, settings: &Value| {
        page.result(
            "smpl/export",
            json!({"uri": uri(&file), "format": format, "settings": settings, "mathml": ["<math><mi>x</mi></math>"]}),
        )
    };
    let csv = export("csv", &settings)["text"].as_str().expect("text").to_owned();
    let yaml = export("yaml", &settings)["text"].as_str().expect("text").to_owned();
    folder.write("decay.mine.yaml", &yaml);
    let out = folder.path().join("out.csv");
    let command = std::process::Command::new(env!("CARGO_BIN_EXE_smpl"))
        .args(["simulate", "--scenario", "mine", "--seed", "7", "--out"])
        .args([&out, &file])
        .output()
        .expect("smpl runs");
    assert!(command.status.success(), "{}\n{yaml}", String::from_utf8_lossy(&command.stderr));
    let rows = |text: &str| -> Vec<Vec<f64>> {
        text.lines().skip(1).map(|line| line.split(',').map(|cell| cell.parse().unwrap_or(f64::NAN)).collect()).collect()
    };
    let (mine, theirs) = (rows(&csv), rows(&std::fs::read_to_string(out).expect("a table")));
    assert_eq!(csv.lines().next().map(|line| line.starts_with("step,time,x")), Some(true));
    assert_eq!(mine.len(), 5);
    close(&mine.iter().map(|row| row[2]).collect::<Vec<f64>>(), theirs.iter().map(|row| row[2]));
    assert!(export("svg", &settings)["text"].as_str().is_some_and(|text| text.starts_with("<svg")));
    assert!(export("png", &settings)["base64"].as_str().is_some());
    let html = export("html", &settings)["text"].as_str().expect("text").to_owned();
    assert!(html.contains("<math><mi>x</mi></math>") && html.contains("eq d/dt x = u - k*x") && !html.contains("src="));
    let python = export("python", &settings)["text"].as_str().expect("text").to_owned();
    assert!(python.contains("smpl.Env(") && python.contains("\"k\": 1") && python.contains("\"state\": {\"x\": 3}"), "{python}");
    let sweep = export("csv", &json!({"sweep": {"name": "k", "values": [1, 2]}}))["text"].as_str().expect("text").to_owned();
    assert!(sweep.starts_with("run,step,time") && sweep.contains("k = 2,8,8"), "{sweep}");
}

#[test]
fn what_cannot_be_served_is_refused_in_one_sentence() {
    let folder = Folder::new();
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = listener.local_addr().expect("an address").port().to_string();
    let good = folder.write("decay.eq", DECAY);
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).expect("a folder");
    let cases = [
        (vec![folder.path().join("none.eq").display().to_string()], "no such file"),
        (vec![empty.display().to_string()], "no models"),
        (vec![folder.write("binary.eq", [0_u8, 159, 146, 150]).display().to_string()], "not UTF-8"),
        (vec![folder.write("nul.eq", [b'm', 0, b'x']).display().to_string()], "not a text"),
        (vec![folder.write("latin.eq", b"# temp\xe9rature\n").display().to_string()], "not UTF-8"),
        (vec![folder.write("large.eq", vec![b' '; 10 << 20]).display().to_string()], "larger than"),
        (vec![folder.write("other.txt", "x").display().to_string()], "ends in .eq"),
        (vec![good.display().to_string(), "--port".into(), port], "in use"),
    ];
    for (arguments, part) in cases {
        let output = command(&Folder::new()).arg("--no-open").args(&arguments).output().expect("smpl runs");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {text}");
        assert!(text.contains(part) && text.lines().count() == 1 && output.stdout.is_empty(), "{text}");
    }
    let mut none = command(&Folder::new());
    let output = none.env_remove("SMPL_LIVE_DIST").args([good.to_str().expect("utf-8"), "--port", "notaport"]).output().expect("smpl runs");
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn a_text_that_is_too_large_is_refused_and_the_page_goes_on() {
    let folder = Folder::new();
    let file = folder.write("decay.eq", DECAY);
    let live = live(&folder);
    let mut page = live.page();
    page.open(&folder.path().join("large.eq"), &" ".repeat(5 << 20));
    let message = page.wait("message", |message| message["method"] == "window/showMessage");
    assert!(message["params"]["message"].as_str().is_some_and(|text| text.contains("larger")));
    let save = json!({"uri": uri(&file), "text": " ".repeat(5 << 20), "digest": null, "force": true});
    assert_eq!(page.call("smpl/save", save).expect_err("too large").0, 6);
    assert!(page.call("smpl/run", json!({"uri": uri(&file), "settings": {}})).is_ok());
    let mut byte = [0];
    let _ = page.socket.get_mut().read(&mut byte);
}
