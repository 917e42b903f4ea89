//! The command `smpl`.

fn main() {
    std::process::exit(smpl_tools::cli::run(std::env::args_os()));
}
