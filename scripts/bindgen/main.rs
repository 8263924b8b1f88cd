//! `bindgen WASM FOLDER`: the JavaScript and TypeScript of a compiled browser build, as `wasm-bindgen --target web
//! --out-name gravisight` writes them. That program comes with a web server and an HTTP client for its tests, which are
//! most of what is compiled.

use std::error::Error;

use wasm_bindgen_cli_support::Bindgen;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<_> = std::env::args_os().skip(1).collect();
    let [wasm, folder] = arguments.as_slice() else {
        return Err("two paths are needed: the compiled wasm, and the folder to write to".into());
    };
    let mut bindgen = Bindgen::new();
    bindgen.web(true)?.input_path(wasm).out_name("gravisight").typescript(true);
    // Without an address the loader takes the wasm beside it.
    bindgen.omit_default_module_path(false);
    bindgen.generate(folder)?;
    Ok(())
}
