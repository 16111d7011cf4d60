//! Calls of a device, up to its first failure.

use std::cell::RefCell;
use std::rc::Rc;

use super::arguments::Arguments;
use super::{Address, Device, DeviceError, Product};

/// Passes calls to a device until one fails; later ones do nothing, and what they read is not a number.
#[derive(Clone, Debug)]
pub(crate) struct Queue {
    device: Rc<dyn Device>,
    failure: Rc<RefCell<Option<DeviceError>>>,
}

/// Memory on the device.
#[derive(Debug)]
pub(crate) struct Buffer {
    device: Rc<dyn Device>,
    address: Address,
    words: usize,
}

impl Drop for Buffer {
    fn drop(&mut self) {
        if self.address != 0 {
            self.device.free(self.address, self.words);
        }
    }
}

impl Buffer {
    /// Its length in words of 8 bytes.
    pub(crate) fn len(&self) -> usize {
        self.words
    }

    /// Address of its number `i`.
    pub(crate) fn at(&self, i: usize) -> Address {
        self.address + 8 * i as u64
    }

    /// Address of its index `i`, where it holds indices.
    pub(crate) fn index_at(&self, i: usize) -> Address {
        self.address + 4 * i as u64
    }
}

impl Queue {
    pub(crate) fn new(device: Rc<dyn Device>) -> Self {
        Self { device, failure: Rc::default() }
    }

    pub(crate) fn device(&self) -> &Rc<dyn Device> {
        &self.device
    }

    /// The first failure.
    pub(crate) fn failure(&self) -> Option<DeviceError> {
        self.failure.borrow().clone()
    }

    fn call<T: Default>(&self, call: impl FnOnce(&dyn Device) -> Result<T, DeviceError>) -> T {
        if self.failure.borrow().is_some() {
            return T::default();
        }
        call(&*self.device).unwrap_or_else(|error| {
            *self.failure.borrow_mut() = Some(error);
            T::default()
        })
    }

    /// Memory for numbers, which are zero.
    pub(crate) fn buffer(&self, words: usize) -> Buffer {
        let address = self.call(|device| device.allocate(words.max(1)));
        Buffer { device: self.device.clone(), address, words: words.max(1) }
    }

    pub(crate) fn numbers(&self, values: &[f64]) -> Buffer {
        let buffer = self.buffer(values.len());
        self.upload(buffer.at(0), values);
        buffer
    }

    pub(crate) fn indices(&self, values: &[u32]) -> Buffer {
        let buffer = self.buffer(values.len().div_ceil(2));
        if !values.is_empty() {
            self.call(|device| device.upload_indices(buffer.at(0), values));
        }
        buffer
    }

    pub(crate) fn upload(&self, to: Address, values: &[f64]) {
        if !values.is_empty() {
            self.call(|device| device.upload(to, values));
        }
    }

    /// Reads numbers; after a failure they are none.
    pub(crate) fn download(&self, from: Address, values: &mut [f64]) {
        if !values.is_empty() {
            self.call(|device| device.download(from, values));
        }
        if self.failure.borrow().is_some() {
            values.fill(f64::NAN);
        }
    }

    pub(crate) fn copy(&self, from: &Buffer, to: &Buffer) {
        self.call(|device| device.copy(from.at(0), to.at(0), from.len()));
    }

    pub(crate) fn clear(&self, at: Address, words: usize) {
        self.call(|device| device.clear(at, words));
    }

    pub(crate) fn launch(&self, kernel: &'static str, arguments: &Arguments) {
        if arguments.threads() > 0 {
            self.call(|device| device.launch(kernel, arguments.threads(), arguments.words()));
        }
    }

    pub(crate) fn multiply(&self, product: &Product) {
        self.call(|device| device.multiply(product));
    }
}
