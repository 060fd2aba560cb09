//! One row of outputs of a stream: what the sliding weights left, and what else is wanted.

#![expect(clippy::indexing_slicing, reason = "results have a place for every sample")]

use super::fitted::{Missing, Results, Wanted};
use super::window::{Allowed, Local, Memory, Seen};
use crate::engine::Sample;
use crate::error::Error;

/// One row of outputs among several.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    /// Which one.
    pub number: usize,
    /// Of how many.
    pub rows: usize,
    pub channels: usize,
}

impl Row {
    fn at(self, order: usize, channel: usize) -> usize {
        (order * self.rows + self.number) * self.channels + channel
    }
}

/// One design's part of a row of outputs.
pub(super) struct Task<'a> {
    pub local: &'a Local,
    pub span: usize,
    /// The number of the design, and that of its first order.
    pub part: (usize, usize),
    pub wanted: Wanted,
}

impl Task<'_> {
    /// Fits what the sliding weights did not give in a row of outputs, and adds what else is wanted.
    pub fn complete<T: Sample>(
        &self,
        seen: &Seen<'_, T>,
        memory: &mut Memory,
        row: Row,
        results: &mut Results<'_, T>,
    ) -> Result<(), Error> {
        let (index, first) = self.part;
        let full = seen.samples() == self.span;
        let slid = full && seen.times.is_none();
        let allowed = Allowed {
            missing: self.wanted.missing == Missing::Omit,
            support: self.wanted.support.max(self.local.least()),
            gain: self.wanted.gain,
        };
        memory.begin();
        for channel in 0..row.channels {
            let none = results.estimate[row.at(first, channel)].to_f64().is_nan();
            let fitted =
                if slid { none && allowed.missing && holds_missing(seen, channel) } else { full || self.wanted.grow };
            if fitted {
                self.local.fit(seen, channel, allowed, memory, |order, value, variance| {
                    let at = row.at(first + order, channel);
                    results.estimate[at] = T::from_f64(value);
                    if let Some(std) = &mut results.std {
                        std[at] = T::from_f64(variance.sqrt());
                    }
                })?;
            } else if let Some(std) = &mut results.std {
                for order in 0..self.local.orders() {
                    let at = row.at(first + order, channel);
                    let none = results.estimate[at].to_f64().is_nan();
                    std[at] = T::from_f64(if none { f64::NAN } else { self.local.norm(order) });
                }
            }
            if let Some(support) = &mut results.support {
                let there = if full || self.wanted.grow { present(seen, channel) } else { 0 };
                support[row.at(index, channel)] = there as i64;
            }
        }
        Ok(())
    }
}

fn present<T: Sample>(seen: &Seen<'_, T>, channel: usize) -> usize {
    seen.channel(channel).filter(|value| !value.is_nan()).count()
}

fn holds_missing<T: Sample>(seen: &Seen<'_, T>, channel: usize) -> bool {
    seen.channel(channel).any(f64::is_nan)
}
