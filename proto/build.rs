//! Compiles `palpate.proto` with protox (no system `protoc`) and keeps its descriptor set without comments: recordings
//! embed it as their schema, and `palpate.desc` is it.
use std::{env, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo:rerun-if-changed=palpate.proto");
    let descriptors = protox::compile(["palpate.proto"], ["."])?;
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let mut plain = descriptors.clone();
    plain.file.iter_mut().for_each(|file| file.source_code_info = None);
    fs::write(out.join("palpate.bin"), protox::prost::Message::encode_to_vec(&plain))?;
    prost_build::compile_fds(descriptors)?;
    Ok(())
}
