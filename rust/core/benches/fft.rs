//! Cost of the engine "fft": overlap-save.

mod common;

fn main() -> Result<(), common::Failure> {
    common::bench("fft")
}
