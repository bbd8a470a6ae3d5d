//! Sets the linker arguments of the image. If they were in `.cargo/config.toml`, RUSTFLAGS would silently override
//! them, and the image would have only a few bytes.

use std::env;
use std::path::Path;

fn main() {
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package is in a folder of the workspace");
    println!("cargo:rerun-if-changed={}", root.join("memory.x").display());
    println!("cargo:rustc-link-search={}", root.display());
    let mut arguments = vec!["--nmagic", "-Tlink.x", "-Tdefmt.x"];
    if env::var_os("CARGO_FEATURE_NUCLEO_F446RE").is_some() {
        arguments.push("--defsym=_nucleo_f446re=1");
    }
    for argument in arguments {
        println!("cargo:rustc-link-arg-bins={argument}");
        println!("cargo:rustc-link-arg-examples={argument}");
    }
}
