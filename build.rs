//! The program finds MuJoCo's library where it was linked from, so that nobody has to set `LD_LIBRARY_PATH`.

fn main() {
    println!("cargo::rerun-if-env-changed=MUJOCO_DYNAMIC_LINK_DIR");
    if let (Ok(dir), Some(_)) = (std::env::var("MUJOCO_DYNAMIC_LINK_DIR"), std::env::var_os("CARGO_FEATURE_MUJOCO")) {
        println!("cargo::rustc-link-arg=-Wl,-rpath,{dir}");
    }
}
