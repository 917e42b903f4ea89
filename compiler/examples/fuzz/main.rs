//! Changes models at random, by words and by bytes, and puts the result through the whole compiler: `fuzz --minutes 10` from the root of
//! the repository. Whatever the text, the parser, the formatter and the front end must end in a result or in faults, soon and in bounded
//! memory. A formatted text must stay unchanged by the formatter, every pass must keep the invariants of the model, and a model must
//! become machine code whose residual can be evaluated.
//!
//! The texts that are changed are all models of the repository: files, code blocks of Markdown pages, and texts in the sources of tests.
//! They are tried in a child process with limits of memory and of time, so that a fault ends that process and nothing else. What takes long,
//! takes much, panics or ends the process is written to `fuzz-SEED.eq` and reported.

mod mutate;

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use smpl_compiler::compile::flatten;
use smpl_compiler::compiled::{BackEndSettings, CompiledModel};
use smpl_compiler::elaborate::Options;
use smpl_dsl::diagnostic::SourceMap;

use mutate::{Random, bytewise, changed, nested, spliced, words};

/// Longest time that one text may take of a processor.
const LIMIT: Duration = Duration::from_secs(5);
/// Interval of looks at a silent process, and their largest number: on a busy machine it may wait for long.
const LOOK: Duration = Duration::from_secs(5);
const LOOKS: u32 = 120;
/// Most address space of the process that tries texts, in kilobytes.
const MEMORY: u32 = 1_500_000;
/// Stack of the thread that tries texts: the compiler is to need none of its caller.
const STACK: usize = 256 << 10;
/// Texts that one process tries.
const BATCH: u64 = 5000;
/// Folders of models.
const PLACES: &[&str] =
    &["models", "tests", "docs", "README.md", "dsl/tests", "compiler/tests", "compiler/src", "runtime/tests", "runtime/src"];

/// Passes that a text must survive; returns `true` for a model.
fn survive(text: &str, folder: &Path) -> bool {
    if let Ok(once) = smpl_dsl::format::format(text) {
        assert!(smpl_dsl::format::format(&once).is_ok_and(|twice| twice == once), "a second pass of the formatter changes the text");
    }
    let mut sources = SourceMap::new();
    let main = sources.add("model.eq", text);
    let mut loader = |name: &str| Some((name.to_owned(), std::fs::read_to_string(folder.join(name)).ok()?));
    let options = Options { verify: true, ..Options::default() };
    let Ok((model, _)) = flatten(&mut sources, main, &mut loader, &options) else { return false };
    let Ok(model) = CompiledModel::build(model, &BackEndSettings::default()) else { return true };
    assert_eq!(model.model().verify(), Ok(()), "the back end breaks an invariant");
    let mut memory = model.memory();
    let n = model.unknowns();
    let (mut y, yp, mut out) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    model.parameters(&mut memory);
    model.prepare_parameters(&mut memory);
    model.initial_states(&mut memory, &mut y);
    model.initial_discretes(&mut memory, &mut y);
    model.prepare_step(&mut memory);
    model.residual(&mut memory, 0.0, &y, &yp, &mut out);
    let mut entries = vec![0.0; model.pattern().row_indices.len()];
    model.jacobian(&mut memory, 0.0, &y, &yp, 1.0, &mut entries);
    true
}

/// Files in a folder and below it, or the file itself.
fn files(path: &Path, out: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(path) else { return out.push(path.to_owned()) };
    let mut entries: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    entries.sort();
    entries.iter().for_each(|entry| files(entry, out));
}

/// The models in a file: its text, the code blocks of a page, or the longer texts of a source.
fn models_in(path: &Path) -> Vec<String> {
    let Ok(text) = std::fs::read_to_string(path) else { return Vec::new() };
    match path.extension().and_then(|e| e.to_str()) {
        Some("eq") => vec![text],
        Some("md") => text.split("```").skip(1).step_by(2).filter_map(|block| Some(block.split_once('\n')?.1.to_owned())).collect(),
        Some("rs" | "py") => quoted(&text),
        _ => Vec::new(),
    }
}

/// Texts between quotes that look like statements.
fn quoted(source: &str) -> Vec<String> {
    let mut out = Vec::new();
    let mut rest = source;
    while let Some(at) = rest.find('"') {
        let triple = rest[at..].starts_with("\"\"\"");
        let raw = rest[..at].ends_with('#');
        let (open, close) = match (triple, raw) {
            (true, _) => (3, "\"\"\""),
            (_, true) => (1, "\"#"),
            _ => (1, "\""),
        };
        let Some(content) = rest.get(at + open..) else { break };
        let end = content.match_indices(close).map(|(end, _)| end).find(|&end| raw || !content[..end].ends_with('\\'));
        let Some(end) = end else { break };
        out.push(content[..end].replace("\\n", "\n").replace("\\\"", "\"").replace("{{", "{").replace("}}", "}"));
        rest = &content[end + close.len()..];
    }
    let statement =
        |line: &str| ["eq ", "state ", "param ", "let ", "var ", "use ", "observe "].iter().any(|k| line.trim_start().starts_with(k));
    out.retain(|text| text.lines().any(statement));
    out
}

/// A line of the text many times.
fn repeated(text: &str, random: &mut Random) -> String {
    let lines: Vec<&str> = text.lines().collect();
    let at = random.below(lines.len());
    let times = 1 << random.below(12);
    let mut out = Vec::with_capacity(lines.len() + times);
    out.extend(&lines[..at]);
    out.extend(std::iter::repeat_n(lines[at], times));
    out.extend(&lines[at..]);
    out.join("\n")
}

/// The next text.
fn next_text(texts: &[String], tokens: &[Vec<&str>], pool: &[&str], random: &mut Random) -> String {
    // Half of the time a whole file: these come first.
    let files = texts.iter().position(|text| text.lines().count() < 15).unwrap_or(texts.len());
    let half = random.below(2) == 0 && files > 0;
    let at = random.below(if half { files } else { texts.len() });
    match random.below(11) {
        0..=4 => changed(&tokens[at], pool, random),
        10 => repeated(&texts[at], random),
        5..=6 => bytewise(&texts[at], random),
        7 => nested(&tokens[at], random),
        8 => spliced(&texts[at], &texts[random.below(texts.len())], random),
        _ => bytewise(&changed(&tokens[at], pool, random), random),
    }
}

/// Arguments of the command line.
struct Asked {
    minutes: f64,
    /// Most texts.
    texts: u64,
    seed: u64,
    /// Number of texts that a child tries.
    child: Option<u64>,
    paths: Vec<String>,
}

fn asked() -> Asked {
    let mut asked = Asked { minutes: 1.0, texts: u64::MAX, seed: 0, child: None, paths: Vec::new() };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut number = || arguments.next().and_then(|n| n.parse::<f64>().ok()).unwrap_or(1.0);
        match argument.as_str() {
            "--minutes" => asked.minutes = number(),
            "--texts" => asked.texts = number() as u64,
            "--seed" => asked.seed = number() as u64,
            "--child" => asked.child = Some(number() as u64),
            _ => asked.paths.push(argument),
        }
    }
    if asked.paths.is_empty() {
        asked.paths = PLACES.iter().map(|&place| place.to_owned()).collect();
    }
    asked
}

/// The texts that are changed, and their words.
struct Seeds {
    texts: Vec<String>,
}

impl Seeds {
    fn of(paths: &[String]) -> Self {
        let mut list = Vec::new();
        paths.iter().for_each(|path| files(Path::new(path), &mut list));
        let texts: BTreeSet<String> = list.iter().flat_map(|path| models_in(path)).filter(|text| !text.trim().is_empty()).collect();
        let mut texts: Vec<String> = texts.into_iter().collect();
        // Whole models first.
        texts.sort_by_key(|text| text.lines().count() < 15);
        Self { texts }
    }

    /// Calls `each` with the texts of some numbers in the sequence, until `each` ends it.
    fn run(&self, numbers: impl Iterator<Item = u64>, mut each: impl FnMut(u64, &str)) {
        let tokens: Vec<Vec<&str>> = self.texts.iter().map(|t| words(t)).collect();
        let pool: Vec<&str> = tokens.iter().flatten().copied().filter(|w| !w.trim().is_empty()).collect();
        for seed in numbers {
            let mut random = Random(seed.wrapping_mul(0xD134_2543_DE82_EF95));
            each(seed, &next_text(&self.texts, &tokens, &pool, &mut random));
        }
    }
}

fn main() {
    let asked = asked();
    let seeds = Seeds::of(&asked.paths);
    if seeds.texts.is_empty() {
        println!("no models to start from here: run it at the root of the project, or name files or folders");
        println!("usage: fuzz [--minutes M] [--texts N] [--seed N] [FILE or FOLDER]...");
        std::process::exit(2);
    }
    if let Some(count) = asked.child {
        let work = move || try_texts(&seeds, asked.seed, count);
        let thread = std::thread::Builder::new().stack_size(STACK).spawn(work);
        let ended = thread.ok().and_then(|thread| thread.join().ok());
        std::process::exit(i32::from(ended.is_none()));
    }
    let found = Parent { seeds, asked, texts: 0, models: 0, found: 0, slowest: Duration::ZERO }.run();
    std::process::exit(i32::from(found > 0));
}

/// Tries texts, and says of each when it begins and what came out.
fn try_texts(seeds: &Seeds, seed: u64, count: u64) {
    seeds.run(seed + 1..=seed + count, |seed, text| {
        say(&format!("begin {seed}"));
        let result = catch_unwind(AssertUnwindSafe(|| survive(text, Path::new("models"))));
        say(match result {
            Ok(true) => "model",
            Ok(false) => "text",
            Err(_) => "panic",
        });
    });
    say("end");
}

fn say(line: &str) {
    let mut out = std::io::stdout().lock();
    // The parent is gone.
    if writeln!(out, "{line}").and_then(|()| out.flush()).is_err() {
        std::process::exit(0);
    }
}

/// Processor time of a process; `None` if the system does not report it.
fn processor_time(child: &Child) -> Option<Duration> {
    const TICK: Duration = Duration::from_millis(10);
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", child.id())).ok()?;
    // The name before may hold blanks. User and system time are the fields 14 and 15.
    let (_, fields) = stat.rsplit_once(')')?;
    let ticks = |at: usize| fields.split_whitespace().nth(at).and_then(|ticks| ticks.parse::<u32>().ok());
    Some(TICK * (ticks(11)? + ticks(12)?))
}

/// Starts processes that try texts, and watches them.
struct Parent {
    seeds: Seeds,
    asked: Asked,
    texts: u64,
    models: u64,
    found: u64,
    slowest: Duration,
}

impl Parent {
    fn run(mut self) -> u64 {
        let start = Instant::now();
        let end = start + Duration::from_secs_f64(60.0 * self.asked.minutes);
        println!("{} texts to start from", self.seeds.texts.len());
        let mut seed = self.asked.seed;
        while Instant::now() < end && self.texts < self.asked.texts {
            match self.start(seed) {
                Some((child, lines)) => seed = self.watch(child, &lines, seed, end),
                None => return self.found + 1,
            }
        }
        let minutes = start.elapsed().as_secs_f64() / 60.0;
        println!(
            "{} texts in {minutes:.1} minutes, {} of them models, {} with faults; the slowest took {:?}",
            self.texts, self.models, self.found, self.slowest
        );
        self.found
    }

    /// A process with a limit of memory, and what it says.
    fn start(&self, seed: u64) -> Option<(Child, Receiver<String>)> {
        let program = std::env::current_exe().ok()?;
        let limited = format!("ulimit -v {MEMORY}; ulimit -c 0; exec \"$0\" \"$@\"");
        let mut command = Command::new("sh");
        command.arg("-c").arg(limited).arg(program);
        command.args(["--seed", &seed.to_string(), "--child", &BATCH.to_string()]).args(&self.asked.paths);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().ok()?;
        let output = BufReader::new(child.stdout.take()?);
        let (sender, receiver) = channel();
        std::thread::spawn(move || output.lines().map_while(Result::ok).all(|line| sender.send(line).is_ok()));
        Some((child, receiver))
    }

    /// Follows a process until its end, a fault, or the end of the time; the last number in the sequence that it tried.
    fn watch(&mut self, mut child: Child, lines: &Receiver<String>, mut seed: u64, end: Instant) -> u64 {
        let (mut began, mut used) = (Instant::now(), Duration::ZERO);
        let (mut working, mut looks) = (false, 0);
        let fault = loop {
            let line = match lines.recv_timeout(LOOK) {
                Ok(line) => line,
                Err(RecvTimeoutError::Timeout) => {
                    looks += 1;
                    let slow = processor_time(&child).is_none_or(|now| now.saturating_sub(used) > LIMIT);
                    if slow || looks > LOOKS {
                        break Some("too slow");
                    }
                    continue;
                }
                Err(RecvTimeoutError::Disconnected) => break working.then_some("the process ended: out of memory or of stack"),
            };
            let took = began.elapsed();
            match line.split_once(' ') {
                Some(("begin", number)) => {
                    seed = number.parse().unwrap_or(seed + 1);
                    (began, working, looks) = (Instant::now(), true, 0);
                    used = processor_time(&child).unwrap_or(used);
                    continue;
                }
                _ if line == "end" => break None,
                _ => {}
            }
            working = false;
            self.texts += 1;
            self.models += u64::from(line == "model");
            self.slowest = self.slowest.max(took);
            if line == "panic" {
                self.tell(seed, "panic");
            }
            if Instant::now() > end || self.texts >= self.asked.texts {
                break None;
            }
        };
        if let Some(fault) = fault {
            self.tell(seed, fault);
        }
        // It may have ended already.
        let _ = child.kill();
        let _ = child.wait();
        seed
    }

    /// Writes the text of a fault to a file.
    fn tell(&mut self, seed: u64, fault: &str) {
        self.found += 1;
        let path = format!("fuzz-{seed}.eq");
        println!("{path}: {fault}");
        self.seeds.run(std::iter::once(seed), |_, text| {
            if let Err(error) = std::fs::write(&path, text) {
                println!("{path}: {error}");
            }
        });
    }
}
