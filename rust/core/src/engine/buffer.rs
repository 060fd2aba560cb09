//! Values that start at a cache line.

#![expect(clippy::indexing_slicing, reason = "the room is longer than the values by a whole cache line")]

use std::ops::{Deref, DerefMut};

use crate::error::{Error, at_least};

/// Bytes of a cache line, and of the longest registers.
const LINE: usize = 64;

/// A vector whose first value starts a cache line, so that no register of the others crosses one.
#[derive(Debug)]
pub struct Buffer<T> {
    room: Vec<T>,
    start: usize,
    len: usize,
}

impl<T> Default for Buffer<T> {
    fn default() -> Self {
        Self { room: Vec::new(), start: 0, len: 0 }
    }
}

impl<T: Copy + Default> Buffer<T> {
    /// `len` default values.
    pub fn new(len: usize) -> Result<Self, Error> {
        let mut new = Self::default();
        new.fit(len)?;
        Ok(new)
    }

    /// Sets the length; what the buffer holds does not matter.
    pub fn fit(&mut self, len: usize) -> Result<(), Error> {
        at_least(&mut self.room, len + LINE / size_of::<T>())?;
        // The allocator aligns to the type, at least.
        self.start = self.room.as_ptr().align_offset(LINE).min(self.room.len() - len);
        self.len = len;
        Ok(())
    }
}

impl<T> Deref for Buffer<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.room[self.start..self.start + self.len]
    }
}

impl<T> DerefMut for Buffer<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.room[self.start..self.start + self.len]
    }
}
