//! Arguments of a kernel, as the words of its structure.

use super::Address;

/// Words at most.
const MOST: usize = 64;

/// Arguments of a kernel in the order of its structure; the first is the number of threads.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arguments {
    words: [u64; MOST],
    len: usize,
}

impl Arguments {
    /// For this many threads.
    pub(crate) fn of(threads: usize) -> Self {
        Self { words: [0; MOST], len: 0 }.integer(threads)
    }

    /// Number of threads.
    pub(crate) fn threads(&self) -> usize {
        self.words[0] as usize
    }

    /// All words.
    pub(crate) fn words(&self) -> &[u64] {
        &self.words[..self.len]
    }

    fn word(mut self, word: u64) -> Self {
        self.words[self.len] = word;
        self.len += 1;
        self
    }

    pub(crate) fn address(self, address: Address) -> Self {
        self.word(address)
    }

    pub(crate) fn addresses(self, addresses: [Address; 3]) -> Self {
        addresses.into_iter().fold(self, Self::word)
    }

    pub(crate) fn integer(self, value: usize) -> Self {
        self.word(value as u64)
    }

    pub(crate) fn integers(self, values: &[usize]) -> Self {
        values.iter().fold(self, |words, value| words.integer(*value))
    }

    pub(crate) fn number(self, value: f64) -> Self {
        self.word(value.to_bits())
    }

    pub(crate) fn numbers(self, values: &[f64]) -> Self {
        values.iter().fold(self, |words, value| words.number(*value))
    }
}
