//! Cost of the engine "moments": moments of blocks.

mod common;

fn main() -> Result<(), common::Failure> {
    common::bench("moments")
}
