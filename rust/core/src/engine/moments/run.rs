//! One run: block after block, with the moments that its windows need ahead of it.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined is compiled for the lowest CPU, not for the dispatched one"
)]

use super::super::Sample;
use super::super::prefetch::prefetch;
use super::super::stream::rescale;
use super::Moments;
use super::design::{Order, Shape, Tables};
use super::lay::Lay;
use super::room::{Place, Room, Source};

/// Blocks that are worked on at a time.
pub const STEP: usize = 8;

/// Bytes that are asked for before they are needed.
const AHEAD: usize = 4096;

/// What is to be computed: `x[0]`, a sample of `unit` values, is the sample `origin` of its row; the windows of the outputs
/// start at sample `first` of x and on.
pub struct Run<'a, 'o, T: Sample> {
    pub moments: &'a Moments<T>,
    pub x: &'a [T],
    pub unit: usize,
    pub first: usize,
    pub origin: isize,
    pub outs: &'a mut [&'o mut [T]],
    pub room: &'a mut Room<T>,
}

impl<'a, T: Sample> Run<'a, '_, T> {
    #[inline(always)]
    pub fn go<L: Lay<T>>(mut self, lay: L) {
        let shape = self.moments.tables.shape;
        let block = shape.block.cast_signed();
        let window = self.origin + self.first.cast_signed();
        let lead = window.rem_euclid(STEP.cast_signed() * block).cast_unsigned();
        // Where the step of the first window starts in x, and in its group.
        let start = self.first.cast_signed() - lead.cast_signed();
        let phase = (window - lead.cast_signed()).div_euclid(block).rem_euclid(shape.group.unwrap_or(1).cast_signed()).cast_unsigned();
        let outputs = self.outs.first().map_or(0, |out| out.len() / self.unit);
        self.warm_up(lay, start, phase);
        let mut near = Place { group: 0, index: phase };
        for step in 0..(lead + outputs).div_ceil(STEP * shape.block) {
            let here = start + (step * STEP * shape.block).cast_signed();
            self.ask_ahead(here);
            self.bring(here);
            if shape.whole > 0 {
                self.feed(lay, here, (shape.whole + step * STEP).cast_signed(), phase);
            }
            self.deliver(lay, here, step == 0, near, lead, step * STEP * shape.block);
            near = near.after(STEP, shape.group.unwrap_or(1));
        }
    }

    /// The moments of the blocks before those that come with the first outputs.
    #[inline(always)]
    fn warm_up<L: Lay<T>>(&mut self, lay: L, start: isize, phase: usize) {
        let shape = self.moments.tables.shape;
        let block = shape.block.cast_signed();
        let steps = shape.whole.saturating_sub(1).div_ceil(STEP).cast_signed();
        let first = shape.whole.cast_signed() - steps * STEP.cast_signed();
        self.room.restart(start, start + first * block);
        for number in (0..steps).map(|step| first + step * STEP.cast_signed()) {
            let here = start + (number - shape.whole.cast_signed()) * block;
            // Where one piece holds both, what the first outputs read as their own stays.
            let from = start + if self.room.joined { number.min(0) } else { number } * block;
            let source = self.source();
            self.room.far.bring(source, from, start + (number + STEP.cast_signed()) * block);
            self.feed(lay, here, number, phase);
        }
    }

    /// Asks for what the steps after the next will read and write.
    #[inline(always)]
    fn ask_ahead(&self, here: isize) {
        let Shape { block, whole, reach, .. } = self.moments.tables.shape;
        let (count, ahead) = (STEP * block * self.unit, AHEAD / size_of::<T>());
        let at = |place: isize| (place.max(0).cast_unsigned() * self.unit).saturating_add(ahead);
        prefetch(self.x, at(here + ((whole + 1 + STEP) * block + reach).cast_signed()), count);
        if !self.room.joined {
            prefetch(self.x, at(here), count);
        }
        for out in self.outs.iter() {
            prefetch(out, at(here - self.first.cast_signed()), count);
        }
    }

    #[inline(always)]
    fn source(&self) -> Source<'a, T> {
        Source { x: self.x, unit: self.unit, on_differences: self.moments.on_differences }
    }

    /// The stream that the step at `here` reads.
    #[inline(always)]
    fn bring(&mut self, here: isize) {
        let (source, room) = (self.source(), &mut *self.room);
        let Shape { block, whole, reach, .. } = self.moments.tables.shape;
        let (step, whole) = ((STEP * block).cast_signed(), (whole * block).cast_signed());
        let until = here + whole + block.cast_signed() + step + reach.cast_signed();
        let from = if room.joined { here } else { here + whole };
        room.far.bring(source, from, until);
        if !room.joined {
            room.near.bring(source, here, here + step);
        }
    }

    /// The moments of the blocks from `number` on, counted from that of the first output, and what follows from them; `here`
    /// is where the outputs start that need the first of them as their last.
    #[inline(always)]
    fn feed<L: Lay<T>>(&mut self, lay: L, here: isize, number: isize, phase: usize) {
        let Self { moments: Moments { tables, .. }, unit, room, .. } = self;
        let shape = tables.shape;
        let width = lay.width(tables);
        let at = here + (shape.whole * shape.block).cast_signed();
        let Some(group) = shape.group else {
            let moments = room.plain.next(STEP * width, shape.whole * width);
            lay.moments(tables, room.far.from(*unit, at), moments);
            return;
        };
        lay.moments(tables, room.far.from(*unit, at), &mut room.fresh);
        let (matrix, all) = (shape.moments * tables.stride, number + phase.cast_signed());
        let place = Place { group: 0, index: all.rem_euclid(group.cast_signed()).cast_unsigned() };
        let step = (place.index + group - shape.whole % STEP) % group;
        lay.products(tables, &tables.lift[step * matrix..], &room.fresh, &mut room.parts, false);
        // The end of one group, which is then complete, and the beginning of the next.
        let slot = |group: isize| group.rem_euclid(room.slots.cast_signed()).cast_unsigned();
        let slots = [0, 1].map(|next| slot(all.div_euclid(group.cast_signed()) + next));
        let until = STEP.min(group - place.index);
        for (slot, part) in slots.into_iter().zip([0..until, until..STEP]) {
            let start = (place.index + part.start) % group;
            let complete = start + part.len() == group;
            let blocks = part.start * width..part.end * width;
            let (parts, sums) = (&room.parts[blocks.clone()], &mut room.prefix[blocks]);
            let lifted = &mut room.lifted[slot * group * width..][..group * width];
            lay.run_up(tables, parts, &mut lifted[start * width..][..parts.len()], &mut room.running, sums);
            if complete {
                lay.run_down(tables, lifted);
                lay.repeat(tables, Some(&room.running), &mut room.totals[slot * width..][..width]);
                lay.repeat(tables, None, &mut room.running);
                // Together with its last block a group is a whole one.
                lay.repeat(tables, None, &mut sums[(part.len() - 1) * width..]);
            }
        }
    }

    /// The outputs of the step at `here`, number `done` and on from the start of the first block.
    #[inline(always)]
    fn deliver<L: Lay<T>>(&mut self, lay: L, here: isize, first: bool, near: Place, lead: usize, done: usize) {
        let Self { moments: Moments { tables, .. }, x, unit, outs, room, first: window, .. } = self;
        let shape = tables.shape;
        let length = STEP * shape.block * *unit;
        for (number, (order, out)) in tables.orders.iter().zip(outs.iter_mut()).enumerate() {
            coefficients(lay, tables, order, number, room, near, first);
            let after = (here + ((shape.whole + 1) * shape.block).cast_signed(), &room.far);
            let samples = (if room.joined { &room.far } else { &room.near }).from(*unit, here);
            let further = after.1.from(*unit, after.0);
            let own = T::from_f64(order.scale);
            let exact = own.to_f64() == order.scale;
            let scale = if exact { own } else { T::from_f64(1.0) };
            // The part of the step that is wanted.
            let from = (lead.max(done) - done) * *unit;
            let until = length.min((lead * *unit + out.len()).saturating_sub(done * *unit));
            let place = (done + from / *unit - lead) * *unit;
            let wanted = &mut out[place..place + until - from];
            if wanted.len() == length {
                lay.outputs(tables, order, [samples, further], &room.coefficients, scale, wanted);
            } else {
                lay.outputs(tables, order, [samples, further], &room.coefficients, scale, &mut room.spare);
                wanted.copy_from_slice(&room.spare[from..until]);
            }
            if !exact {
                rescale(wanted, order.scale);
            }
            if let Some(anchor) = order.anchor {
                let x = &x[(*window + anchor) * *unit + place..];
                wanted.iter_mut().zip(x).for_each(|(out, sample)| *out = *out + *sample);
            }
        }
    }
}

/// The coefficients of the outputs of a step, whose first block is `near`.
#[inline(always)]
fn coefficients<T: Sample, L: Lay<T>>(
    lay: L,
    tables: &Tables<T>,
    order: &Order<T>,
    number: usize,
    room: &mut Room<T>,
    near: Place,
    first: bool,
) {
    let shape = tables.shape;
    let width = lay.width(tables);
    if shape.whole == 0 {
        return;
    }
    let Some(group) = shape.group else {
        return lay.blocks(tables, order, room.plain.last((shape.whole + STEP - 1) * width), &mut room.coefficients);
    };
    let (matrix, slot) = (shape.moments * tables.stride, near.group % room.slots);
    let from = near.index * matrix;
    let after = &room.lifted[(slot * group + near.index) * width..][..STEP * width];
    lay.products(tables, &order.near[from..], after, &mut room.coefficients, false);
    if shape.between(group, group - 1) > 0 {
        let whole = &mut room.whole[number * width..][..width];
        let mut known = if near.index == 0 { 0 } else { shape.between(group, near.index - 1) };
        if near.index == 0 || first {
            lay.repeat(tables, None, whole);
            known = 0;
        }
        for k in 0..STEP {
            let between = shape.between(group, near.index + k);
            if k > 0 && between == known {
                continue;
            }
            for distance in known..between {
                let slot = (near.group + distance + 1) % room.slots;
                lay.product(tables, &order.groups[distance * matrix..], &room.totals[slot * width..][..width], whole);
            }
            known = between;
            lay.repeat(tables, Some(whole), &mut room.wholes[k * width..]);
        }
        lay.products(tables, &tables.restrict[from..], &room.wholes, &mut room.coefficients, true);
    }
    lay.products(tables, &order.far[from..], &room.prefix, &mut room.coefficients, true);
}
