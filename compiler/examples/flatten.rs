//! Flattens a model and prints what came out.
use smpl_compiler::elaborate::{Options, Setting};
use smpl_dsl::diagnostic::SourceMap;

fn main() {
    let mut args = std::env::args().skip(1);
    let path = args.next().expect("path");
    let mut options = Options::default();
    for a in args {
        if let Some((n, v)) = a.split_once('=') {
            match v.parse::<f64>() {
                Ok(x) => { options.settings.insert(n.into(), Setting::Number(x)); }
                Err(_) => options.variants.push((n.into(), v.into())),
            }
        } else {
            options.variants.push((a, "true".into()));
        }
    }
    let text = std::fs::read_to_string(&path).expect("readable");
    let folder = std::path::Path::new(&path).parent().unwrap().to_owned();
    let mut best = f64::INFINITY;
    for round in 0..20 {
        let mut sources = SourceMap::new();
        let main = sources.add(&path, text.clone());
        let folder = folder.clone();
        let start = std::time::Instant::now();
        let r = smpl_compiler::front::flatten(&mut sources, main, &mut |p| {
            let f = folder.join(p);
            std::fs::read_to_string(&f).ok().map(|t| (p.to_owned(), t))
        }, &options);
        best = best.min(start.elapsed().as_secs_f64());
        if round > 0 { continue; }
        match r {
            Ok((m, w)) => {
                println!("states {} rows {} exprs {} explicit {} algebraic {:?} obs {} warnings {}", m.interface.states.iter().map(|q| q.len()).sum::<usize>(), m.rows.len(), m.exprs.len(), m.explicit, m.interface.algebraic_counts, m.interface.observations.len(), w.len());
                for d in w { let l = sources.locate(d.primary.span); println!("W {}:{}:{} {}", sources.name(d.primary.span.file), l.line, l.column, d.message); }
            }
            Err(e) => {
                for d in e.iter().take(40) { let l = sources.locate(d.primary.span); println!("{} {}:{}:{} {} | {} | {:?}", d.code, sources.name(d.primary.span.file), l.line, l.column, d.message, d.primary.text, d.help); }
                println!("{} faults", e.len());
                return;
            }
        }
    }
    println!("{:.3} ms", best * 1e3);
}
