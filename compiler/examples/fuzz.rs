//! Changes the words of model files at random and compiles the result: `fuzz --minutes 5 models/*.eq`. Whatever the text, the front end
//! must end in a model or in faults, soon. What takes long or panics is written to `fuzz-SEED.eq` and told.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::{Duration, Instant};

use smpl_compiler::elaborate::Options;
use smpl_compiler::front::flatten;
use smpl_dsl::diagnostic::SourceMap;

/// Longest time that one text may take.
const LIMIT: Duration = Duration::from_secs(5);

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
];

fn changed(tokens: &[&str], pool: &[&str], random: &mut Random) -> String {
    let mut list: Vec<&str> = tokens.to_vec();
    for _ in 0..=random.below(6) {
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
    let texts: Vec<String> = paths.iter().filter_map(|p| std::fs::read_to_string(p).ok()).collect();
    if texts.is_empty() {
        println!("usage: fuzz [--minutes M] [--seed N] FILE.eq...");
        return;
    }
    let tokens: Vec<Vec<&str>> = texts.iter().map(|t| words(t)).collect();
    let pool: Vec<&str> = tokens.iter().flatten().copied().filter(|w| !w.trim().is_empty()).collect();
    let folder = Path::new(&paths[0]).parent().map(Path::to_path_buf).unwrap_or_default();
    let (mut count, mut sound, mut found) = (0_u64, 0_u64, 0_u64);
    let start = Instant::now();
    while start.elapsed().as_secs_f64() < 60.0 * minutes {
        seed += 1;
        let mut random = Random(seed.wrapping_mul(0xD134_2543_DE82_EF95));
        let text = changed(&tokens[random.below(tokens.len())], &pool, &mut random);
        let began = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| {
            let mut sources = SourceMap::new();
            let main = sources.add("model.eq", text.clone());
            let mut loader = |name: &str| Some((name.to_owned(), std::fs::read_to_string(folder.join(name)).ok()?));
            flatten(&mut sources, main, &mut loader, &Options::default()).is_ok()
        }));
        count += 1;
        sound += u64::from(matches!(result, Ok(true)));
        if result.is_err() || began.elapsed() > LIMIT {
            found += 1;
            let path = format!("fuzz-{seed}.eq");
            println!("{path}: {}", if result.is_err() { "panic" } else { "slow" });
            if let Err(error) = std::fs::write(&path, &text) {
                println!("{error}");
            }
        }
    }
    println!("{count} texts, {sound} of them models, {found} at fault");
    std::process::exit(i32::from(found > 0));
}
