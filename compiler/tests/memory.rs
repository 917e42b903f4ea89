//! Excessive compilations are refused before they take the memory of the machine.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use smpl_compiler::compile::flatten;
use smpl_compiler::elaborate::Options;
use smpl_dsl::diagnostic::{Diagnostic, SourceMap};

/// The system's allocator, with the bytes that are held and the most that were.
struct Counted;

static HELD: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is the system allocator's; in addition, numbers are counted.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        MOST.fetch_max(HELD.fetch_add(layout.size(), Relaxed) + layout.size(), Relaxed);
        // SAFETY: the caller keeps the contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        MOST.fetch_max(HELD.fetch_add(size, Relaxed) + size - layout.size(), Relaxed);
        HELD.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller keeps the contract.
        unsafe { System.realloc(at, layout, size) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller keeps the contract.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counted = Counted;

/// Most bytes that a compilation may hold.
const BOUND: usize = 600 << 20;

/// Flattens a text; its faults and the most bytes that were held meanwhile.
fn flattened(text: &str) -> (Vec<Diagnostic>, usize) {
    MOST.store(HELD.load(Relaxed), Relaxed);
    let mut sources = SourceMap::new();
    let main = sources.add("model.eq", text);
    let faults = flatten(&mut sources, main, &mut |_| None, &Options::default()).err().unwrap_or_default();
    (faults, MOST.load(Relaxed))
}

/// One test, since the count is of the whole process.
#[test]
fn absurd_sums_are_refused_within_some_hundred_megabytes() {
    let many = |term: &str, n: usize| vec![term; n].join(" + ");
    let scalar = |right: &str| format!("state x = 1\neq d/dt x = ({right})/1 [s]\n");
    let double = |function: &str, body: &str| format!("{function}({function}({body} for i in 1..3000) for j in 1..1000)");
    let array = "set s = 1..2000\nstate c[s] = 1\n";
    let component = "component A { state x = 1 ; eq d/dt x = sum(sum(exp(i*j*x) for i in 1..3000) for j in 1..1000)/1 [s] }\n";
    let rows: String = (1..=1000).map(|i| format!("{i}: {}\n", vec!["0.5"; 400].join(", "))).collect();
    let table = format!("set a = 1..1000\nset b = 1..400\ntable k[a, b] = {{\n{rows}}}\n");
    let texts = [
        scalar(&many(&double("sum", "exp(i*x + j)"), 100)),
        scalar(&many(&double("product", "exp(i*x + j)"), 100)),
        scalar(&many(&double("mean", "if i > j*x then i else exp(j*x)"), 100)),
        scalar(&format!("if {} then 1 else 0", vec![double("any", "i*x > j"); 100].join(" or "))),
        format!("{array}eq d/dt c[i] = sum(sum(exp(k*l*c[i]) for k in 1..3000) for l in 1..1000)/1 [s] for i in s\n"),
        format!("{array}eq d/dt c[i] = max(max(exp(k*l*c[i]) for k in 1..3000) for l in 1..1000)/1 [s] for i in s\n"),
        format!("{component}use A as a[k in 1..300]\n"),
        format!("{table}{}", scalar(&many("sum(k[i, j]*exp(k[i, j]*x) for i in a, j in b)", 100))),
        format!("{table}{}", scalar(&many("max(k[i, j]*exp(k[i, j]*x) for i in a, j in b)", 100))),
        format!(
            "def f(q) = {}\n{}",
            double("sum", "exp(i*q + j)"),
            scalar(&(1..=100).map(|i| format!("f({i}*x)")).collect::<Vec<_>>().join(" + "))
        ),
    ];
    for text in &texts {
        let (faults, most) = flattened(text);
        let head = &text[text.len() - 120..];
        assert!(faults.iter().any(|fault| fault.code.id().starts_with("E0105")), "{head}");
        assert!(most < BOUND, "{} MB: {head}", most >> 20);
    }
}
