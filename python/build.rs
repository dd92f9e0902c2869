//! On macOS a library that the interpreter loads must say that the interpreter's symbols come later.

fn main() {
    pyo3_build_config::add_extension_module_link_args();
}
