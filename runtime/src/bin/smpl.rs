//! The command `smpl`.

fn main() {
    std::process::exit(smpl_runtime::cli::run(std::env::args_os()));
}
