//! Random changes of texts, shared by the fuzzer and by tests of other crates.

/// A reproducible stream of whole numbers (splitmix64).
pub struct Random(pub u64);

impl Random {
    /// A number below `n`, which counts as at least 1.
    pub fn below(&mut self, n: usize) -> usize {
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
pub fn words(text: &str) -> Vec<&str> {
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

/// Changes words: removes, inserts, replaces, swaps and repeats them. `pool` holds words of other texts.
pub fn changed(tokens: &[&str], pool: &[&str], random: &mut Random) -> String {
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
pub fn bytewise(text: &str, random: &mut Random) -> String {
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
pub fn nested(tokens: &[&str], random: &mut Random) -> String {
    let (open, close) = NESTS[random.below(NESTS.len())];
    let depth = 1 << random.below(13);
    let at = random.below(tokens.len());
    format!("{}{}{}{}{}", tokens[..at].concat(), open.repeat(depth), tokens[at], close.repeat(depth), tokens[at + 1..].concat())
}

/// The lines of one text up to somewhere, then those of another.
pub fn spliced(first: &str, second: &str, random: &mut Random) -> String {
    let (first, second): (Vec<&str>, Vec<&str>) = (first.lines().collect(), second.lines().collect());
    let (end, begin) = (random.below(first.len() + 1), random.below(second.len() + 1));
    [&first[..end], &second[begin..]].concat().join("\n")
}
