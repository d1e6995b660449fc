//! A reader that counts lines.

use std::io::{BufRead, Read};

/// A reader that knows how many lines were taken from it.
pub(super) struct Counting<'a> {
    pub rest: &'a [u8],
    pub lines: usize,
}

impl Read for Counting<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.rest.read(buffer)
    }
}

impl BufRead for Counting<'_> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        let end = self.rest.iter().position(|&b| b == b'\n');
        Ok(&self.rest[..end.map_or(self.rest.len(), |e| e + 1)])
    }

    fn consume(&mut self, amount: usize) {
        let (taken, rest) = self.rest.split_at(amount.min(self.rest.len()));
        self.lines += taken.iter().filter(|&&b| b == b'\n').count();
        self.rest = rest;
    }
}
