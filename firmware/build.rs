//! Linker arguments of the image. They stand here and not in `.cargo/config.toml`, where a set RUSTFLAGS drops them
//! without a word: the build then succeeds with an image of a few bytes.

use std::env;
use std::path::PathBuf;

fn main() {
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let board = if env::var_os("CARGO_FEATURE_NUCLEO_F446RE").is_some() { "nucleo_f446re" } else { "nucleo_f429zi" };
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("src/board").join(board);
    println!("cargo:rerun-if-changed={}", folder.join("memory.x").display());
    println!("cargo:rustc-link-search={}", folder.display());
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
        println!("cargo:rustc-link-arg-examples={argument}");
    }
}
