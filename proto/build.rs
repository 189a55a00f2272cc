//! Compiles `palpate.proto` with protox (no system `protoc`) and keeps its descriptor set: recordings embed it as
//! their schema.
use std::{env, fs, path::PathBuf};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo:rerun-if-changed=palpate.proto");
    let descriptors = protox::compile(["palpate.proto"], ["."])?;
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::write(out.join("palpate.bin"), protox::prost::Message::encode_to_vec(&descriptors))?;
    prost_build::compile_fds(descriptors)?;
    Ok(())
}
