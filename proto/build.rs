//! Compiles `palpate.proto` with protox (no system `protoc`) and keeps its descriptor set without comments: recordings
//! embed it as their schema, and `palpate.desc` is it. So too `foxglove.proto`, where exports are wanted.
use std::{env, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = PathBuf::from(env::var("OUT_DIR")?);
    for name in ["palpate", "foxglove"] {
        if name == "foxglove" && env::var_os("CARGO_FEATURE_FOXGLOVE").is_none() {
            continue;
        }
        let file = format!("{name}.proto");
        println!("cargo:rerun-if-changed={file}");
        let descriptors = protox::compile([file], ["."])?;
        let mut plain = descriptors.clone();
        plain.file.iter_mut().for_each(|file| file.source_code_info = None);
        fs::write(out.join(format!("{name}.bin")), protox::prost::Message::encode_to_vec(&plain))?;
        prost_build::compile_fds(descriptors)?;
    }
    Ok(())
}
