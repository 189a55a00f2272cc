//! temporary
#[path = "../tests/fake_server/mod.rs"]
mod fake_server;
fn main() {
    let server = fake_server::FakeServer::current();
    println!("{} {}", server.endpoints.force, server.endpoints.surface);
    loop { std::thread::park(); }
}
