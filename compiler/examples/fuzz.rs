//! Changes model files at random, by words and by bytes, and puts the result through the whole compiler:
//! `fuzz --minutes 10 models/*.eq models/lib/*.eq tests/language/*.md`. Whatever the text, the parser, the formatter and the front end must end in
//! a result or in faults, soon and in bounded memory; what is formatted must stay so; what is a model must become machine code whose
//! residual can be evaluated. What takes long, takes much or panics is written to `fuzz-SEED.eq` and told; the text at work is always in
//! `fuzz-current.eq`, for the case that the process itself ends.

use std::alloc::{GlobalAlloc, Layout, System};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

use smpl_compiler::compiled::{BackEndSettings, CompiledModel};
use smpl_compiler::elaborate::Options;
use smpl_compiler::front::flatten;
use smpl_dsl::diagnostic::SourceMap;

/// Longest time that one text may take.
const LIMIT: Duration = Duration::from_secs(5);
/// Most memory that one text may take at a time.
const MOST: usize = 1 << 30;
/// Stack of the thread that works: what a thread has by default.
const STACK: usize = 2 << 20;

/// The system's allocator, which keeps count.
struct Counting;

static IN_USE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is handed on to the system's allocator as it is.
#[expect(unsafe_code, reason = "an allocator is made of unsafe functions")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        PEAK.fetch_max(IN_USE.fetch_add(layout.size(), Relaxed) + layout.size(), Relaxed);
        // SAFETY: the caller's promises are those that the system's allocator asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        IN_USE.fetch_sub(layout.size(), Relaxed);
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// A reproducible stream of whole numbers (splitmix64).
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) % n.max(1) as u64) as usize
    }
}

/// Mostly none or one, at most seven: a text with many changes is hardly ever a model.
fn few(random: &mut Random) -> usize {
    let most = 1 << random.below(4);
    random.below(most)
}

/// Words, numbers, blanks and single signs.
fn words(text: &str) -> Vec<&str> {
    let mut out = Vec::new();
    let mut start = 0;
    let kind = |c: char| {
        if c.is_alphanumeric() || c == '_' {
            1
        } else if c == ' ' {
            2
        } else {
            3
        }
    };
    let mut last = 0;
    for (at, c) in text.char_indices() {
        let k = kind(c);
        if at > start && (k != last || k == 3) {
            out.push(&text[start..at]);
            start = at;
        }
        last = k;
    }
    out.push(&text[start..]);
    out
}

const SPICE: &[&str] = &[
    "1e18",
    "0",
    "-1",
    "inf",
    "0/0",
    "steady(",
    "previous(",
    "der(",
    "div(",
    "grad(",
    "sum(",
    "for",
    "in",
    "if",
    "then",
    "else",
    ")",
    "(",
    "[",
    "]",
    "{",
    "}",
    "..",
    "=",
    "\n",
    "z.last",
    "t",
    "[m]",
    "as [s]",
    "unit(",
    "var",
    "let",
    "state",
    "param",
    "eq",
    "1",
    "2",
    "~",
    "uniform(0, 1)",
    "clip bounds",
    "when",
    "^",
    "99999999999",
    "-9223372036854775808",
    "1e308",
    "0x",
    "[1000000000000]",
    "integral(",
    "initial(",
    "product(",
    "max(",
    "default",
    "event",
    "reset",
    "next",
    "fail",
    "\"",
    "#",
    ":",
    ",",
    ";",
    "°",
];

/// Openings that may nest, with their ends.
const NESTS: &[(&str, &str)] = &[
    ("(", ")"),
    ("-(", ")"),
    ("sum(", " for i in 1..2)"),
    ("if true then ", " else 1"),
    ("sq(", ")"),
    ("1 + ", ""),
    ("2^", ""),
    ("not ", ""),
    ("variant a {\n", "}\n"),
    ("when true {\n", "}\n"),
];

fn changed(tokens: &[&str], pool: &[&str], random: &mut Random) -> String {
    let mut list: Vec<&str> = tokens.to_vec();
    for _ in 0..=few(random) {
        if list.is_empty() {
            break;
        }
        let at = random.below(list.len());
        match random.below(6) {
            0 => {
                list.remove(at);
            }
            1 => list.insert(at, SPICE[random.below(SPICE.len())]),
            2 => list[at] = SPICE[random.below(SPICE.len())],
            3 => list[at] = pool[random.below(pool.len())],
            4 => {
                let other = random.below(list.len());
                list.swap(at, other);
            }
            _ => {
                // A stretch of the text once more, somewhere else.
                let end = (at + random.below(30)).min(list.len());
                let stretch: Vec<&str> = list[at..end].to_vec();
                let to = random.below(list.len());
                list.splice(to..to, stretch);
            }
        }
    }
    list.concat()
}

/// Changes single bytes: flips, digits, deletions, repeats. The result is UTF-8 again.
fn bytewise(text: &str, random: &mut Random) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..=few(random) {
        if bytes.is_empty() {
            break;
        }
        let at = random.below(bytes.len());
        match random.below(5) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => {
                if let Some(digit) = bytes[at..].iter_mut().find(|b| b.is_ascii_digit()) {
                    *digit = b'0' + random.below(10) as u8;
                }
            }
            2 => {
                let end = (at + random.below(40)).min(bytes.len());
                bytes.drain(at..end);
            }
            3 => bytes.insert(at, random.below(128) as u8),
            _ => {
                let digits = "9".repeat(random.below(25)).into_bytes();
                bytes.splice(at..at, digits);
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Replaces a word by one inside many brackets or blocks.
fn nested(tokens: &[&str], random: &mut Random) -> String {
    let (open, close) = NESTS[random.below(NESTS.len())];
    let depth = 1 << random.below(13);
    let at = random.below(tokens.len());
    format!("{}{}{}{}{}", tokens[..at].concat(), open.repeat(depth), tokens[at], close.repeat(depth), tokens[at + 1..].concat())
}

/// The lines of one text up to somewhere, then those of another.
fn spliced(first: &str, second: &str, random: &mut Random) -> String {
    let (first, second): (Vec<&str>, Vec<&str>) = (first.lines().collect(), second.lines().collect());
    let (end, begin) = (random.below(first.len() + 1), random.below(second.len() + 1));
    [&first[..end], &second[begin..]].concat().join("\n")
}

/// What a text must stand; whether it is a model.
fn survive(text: &str, folder: &Path) -> bool {
    if let Ok(once) = smpl_dsl::format::format(text) {
        assert!(smpl_dsl::format::format(&once).is_ok_and(|twice| twice == once), "a second pass of the formatter changes the text");
    }
    let mut sources = SourceMap::new();
    let main = sources.add("model.eq", text);
    let mut loader = |name: &str| Some((name.to_owned(), std::fs::read_to_string(folder.join(name)).ok()?));
    let Ok((model, _)) = flatten(&mut sources, main, &mut loader, &Options::default()) else { return false };
    let Ok(model) = CompiledModel::build(model, &BackEndSettings::default()) else { return true };
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

/// The models in a file: its text, or the code blocks of a page.
fn models_in(path: &str) -> Vec<String> {
    let Ok(text) = std::fs::read_to_string(path) else { return Vec::new() };
    if !path.ends_with(".md") {
        return vec![text];
    }
    text.split("```").skip(1).step_by(2).map(|block| block.split_once('\n').map_or("", |(_, code)| code).to_owned()).collect()
}

/// The next text.
fn next_text(texts: &[String], tokens: &[Vec<&str>], pool: &[&str], random: &mut Random) -> String {
    // Half of the time a whole file: these stand first.
    let files = texts.iter().position(|text| text.lines().count() < 15).unwrap_or(texts.len());
    let half = random.below(2) == 0 && files > 0;
    let at = random.below(if half { files } else { texts.len() });
    match random.below(10) {
        0..=4 => changed(&tokens[at], pool, random),
        5..=6 => bytewise(&texts[at], random),
        7 => nested(&tokens[at], random),
        8 => spliced(&texts[at], &texts[random.below(texts.len())], random),
        _ => bytewise(&changed(&tokens[at], pool, random), random),
    }
}

fn main() {
    let mut minutes = 1.0;
    let mut seed = 0_u64;
    let mut paths = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut number = || arguments.next().and_then(|n| n.parse::<f64>().ok()).unwrap_or(1.0);
        match argument.as_str() {
            "--minutes" => minutes = number(),
            "--seed" => seed = number() as u64,
            _ => paths.push(argument),
        }
    }
    let texts: Vec<String> = paths.iter().flat_map(|path| models_in(path)).filter(|text| !text.trim().is_empty()).collect();
    if texts.is_empty() {
        println!("usage: fuzz [--minutes M] [--seed N] FILE...");
        return;
    }
    let folder = Path::new(&paths[0]).parent().map(Path::to_path_buf).unwrap_or_default();
    let work = move || fuzz(&texts, &folder, seed, Duration::from_secs_f64(60.0 * minutes));
    let thread = std::thread::Builder::new().stack_size(STACK).spawn(work);
    let found = thread.ok().and_then(|thread| thread.join().ok()).unwrap_or(1);
    std::process::exit(i32::from(found > 0));
}

/// Tries texts for a while; how many are at fault.
fn fuzz(texts: &[String], folder: &Path, mut seed: u64, time: Duration) -> u64 {
    let tokens: Vec<Vec<&str>> = texts.iter().map(|t| words(t)).collect();
    let pool: Vec<&str> = tokens.iter().flatten().copied().filter(|w| !w.trim().is_empty()).collect();
    let (mut count, mut sound, mut found) = (0_u64, 0_u64, 0_u64);
    let (mut slowest, mut largest) = (Duration::ZERO, 0);
    let start = Instant::now();
    while start.elapsed() < time {
        seed += 1;
        let mut random = Random(seed.wrapping_mul(0xD134_2543_DE82_EF95));
        let text = next_text(texts, &tokens, &pool, &mut random);
        let _ = std::fs::write("fuzz-current.eq", &text);
        let before = IN_USE.load(Relaxed);
        PEAK.store(before, Relaxed);
        let began = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| survive(&text, folder)));
        let (took, used) = (began.elapsed(), PEAK.load(Relaxed).saturating_sub(before));
        (slowest, largest) = (slowest.max(took), largest.max(used));
        count += 1;
        sound += u64::from(matches!(result, Ok(true)));
        let fault = match result {
            Err(_) => "panic",
            Ok(_) if took > LIMIT => "slow",
            Ok(_) if used > MOST => "large",
            Ok(_) => continue,
        };
        found += 1;
        let path = format!("fuzz-{seed}.eq");
        println!("{path}: {fault}, {took:?}, {} MB", used >> 20);
        if let Err(error) = std::fs::write(&path, &text) {
            println!("{error}");
        }
    }
    let _ = std::fs::remove_file("fuzz-current.eq");
    println!("{count} texts, {sound} of them models, {found} at fault; the slowest took {slowest:?}, the largest {} MB", largest >> 20);
    found
}
