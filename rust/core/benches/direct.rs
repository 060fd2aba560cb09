//! Cost of the engine "direct": every tap of every output.

mod common;

fn main() -> Result<(), common::Failure> {
    common::bench("direct")
}
