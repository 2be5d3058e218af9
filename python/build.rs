//! macOS links a module whose symbols the interpreter has only if it is told so.

fn main() {
    pyo3_build_config::add_extension_module_link_args();
}
