//! A GPU of NVIDIA as a [`Device`] of the immersed flow.
//!
//! Driver, compiler (NVRTC) and matrix products (cuBLAS) are loaded when a device is opened. A program with this crate starts on any machine; without these libraries
//! [`open`] says what is missing. Why: `docs/decisions/0077-flow-on-a-gpu.md`.

use std::collections::HashMap;
use std::ffi::c_void;
use std::rc::Rc;
use std::sync::Arc;

use cudarc::cublas::{CudaBlas, result as blas, sys::cublasOperation_t as Operation};
use cudarc::driver::{CudaContext, CudaFunction, CudaStream, result, sys};
use cudarc::nvrtc::{CompileOptions, compile_ptx_with_opts};
use immersed::device::{Address, Device, DeviceError, KERNEL_NAMES, KERNELS, Product};

/// Threads of a block.
const BLOCK: usize = 256;

/// A GPU and the kernels that were compiled for it.
#[derive(Debug)]
struct Gpu {
    name: String,
    context: Arc<CudaContext>,
    stream: Arc<CudaStream>,
    blas: CudaBlas,
    kernels: HashMap<&'static str, CudaFunction>,
}

/// Opens the first GPU that the process may use (`CUDA_VISIBLE_DEVICES`).
///
/// # Errors
/// No driver, no GPU, a missing library, kernels that do not compile.
pub fn open() -> Result<Rc<dyn Device>, DeviceError> {
    let failure = |what: String| DeviceError { device: "GPU".into(), what };
    // SAFETY: the libraries are those of NVIDIA, whose initialisers any program may run.
    let [driver, compiler, products] = unsafe {
        [
            cudarc::driver::sys::is_culib_present(),
            cudarc::nvrtc::sys::is_culib_present(),
            cudarc::cublas::sys::is_culib_present(),
        ]
    };
    let missing = [
        (driver, "libcuda, of the driver"),
        (compiler, "libnvrtc, of the CUDA toolkit"),
        (products, "libcublas, of the CUDA toolkit"),
    ];
    if let Some((_, library)) = missing.iter().find(|(found, _)| !found) {
        return Err(failure(format!(
            "{library}, was not found; install it, or add its folder to LD_LIBRARY_PATH"
        )));
    }
    let of_driver = |what: &str, e: result::DriverError| failure(format!("{what}: {e}"));
    let context = CudaContext::new(0).map_err(|e| of_driver("no GPU", e))?;
    let name = context.name().map_err(|e| of_driver("its name", e))?;
    let (major, minor) = context.compute_capability().map_err(|e| of_driver("its capability", e))?;
    let options = CompileOptions {
        options: vec![format!("--gpu-architecture=compute_{major}{minor}")],
        ..CompileOptions::default()
    };
    let compiled = compile_ptx_with_opts(KERNELS, options)
        .map_err(|e| failure(format!("the kernels do not compile: {e:?}")))?;
    let module = context.load_module(compiled).map_err(|e| of_driver("the kernels do not load", e))?;
    let mut kernels = HashMap::new();
    for kernel in KERNEL_NAMES {
        kernels.insert(kernel, module.load_function(kernel).map_err(|e| of_driver(kernel, e))?);
    }
    let stream = context.default_stream();
    let blas = CudaBlas::new(stream.clone()).map_err(|e| failure(format!("cuBLAS: {e}")))?;
    Ok(Rc::new(Gpu { name, context, stream, blas, kernels }))
}

impl Gpu {
    fn failure(&self, what: &str, error: &dyn std::fmt::Display) -> DeviceError {
        DeviceError { device: self.name.clone(), what: format!("{what}: {error}") }
    }

    fn queue(&self) -> sys::CUstream {
        self.stream.cu_stream()
    }

    fn upload_bytes<T>(&self, to: Address, values: &[T]) -> Result<(), DeviceError> {
        // SAFETY: the address is one of `allocate` with room for the values, which the driver copies before it returns: they are in pageable memory.
        unsafe { result::memcpy_htod_async(to, values, self.queue()) }.map_err(|e| self.failure("copy", &e))
    }
}

impl Device for Gpu {
    fn name(&self) -> String {
        self.name.clone()
    }

    fn allocate(&self, words: usize) -> Result<Address, DeviceError> {
        let bytes = 8 * words;
        let wrong = |e: result::DriverError| {
            let gib = |bytes: usize| bytes as f64 / f64::from(1u32 << 30);
            let free = self.context.mem_get_info().map_or(0, |(free, _)| free);
            self.failure(
                &format!("no memory for {:.3} GiB more, {:.1} GiB are free", gib(bytes), gib(free)),
                &e,
            )
        };
        // SAFETY: all uses of the memory are in this queue.
        unsafe {
            let address = result::malloc_async(self.queue(), bytes).map_err(wrong)?;
            result::memset_d8_async(address, 0, bytes, self.queue()).map_err(wrong)?;
            Ok(address)
        }
    }

    fn free(&self, address: Address, _: usize) {
        // SAFETY: the address is one of `allocate`. An error was reported by the call that caused it.
        let _ = unsafe { result::free_async(address, self.queue()) };
    }

    fn upload(&self, to: Address, values: &[f64]) -> Result<(), DeviceError> {
        self.upload_bytes(to, values)
    }

    fn upload_indices(&self, to: Address, values: &[u32]) -> Result<(), DeviceError> {
        self.upload_bytes(to, values)
    }

    fn download(&self, from: Address, values: &mut [f64]) -> Result<(), DeviceError> {
        // SAFETY: the address is one of `allocate`, and the copy is waited for.
        unsafe { result::memcpy_dtoh_async(values, from, self.queue()) }
            .and_then(|()| self.stream.synchronize())
            .map_err(|e| self.failure("copy", &e))
    }

    fn copy(&self, from: Address, to: Address, words: usize) -> Result<(), DeviceError> {
        // SAFETY: both addresses are of `allocate`.
        unsafe { result::memcpy_dtod_async(to, from, 8 * words, self.queue()) }
            .map_err(|e| self.failure("copy", &e))
    }

    fn clear(&self, at: Address, words: usize) -> Result<(), DeviceError> {
        // SAFETY: the address is of `allocate`.
        unsafe { result::memset_d8_async(at, 0, 8 * words, self.queue()) }
            .map_err(|e| self.failure("clear", &e))
    }

    fn launch(&self, kernel: &'static str, threads: usize, arguments: &[u64]) -> Result<(), DeviceError> {
        let run = &self.kernels[kernel];
        let blocks = u32::try_from(threads.div_ceil(BLOCK)).map_err(|e| self.failure(kernel, &e))?;
        let mut words = [arguments.as_ptr().cast::<c_void>().cast_mut()];
        // SAFETY: the kernel has one argument, a structure of these words, which the driver copies; a test of the crate `immersed` compares both.
        unsafe {
            result::launch_kernel(
                run.cu_function(),
                (blocks, 1, 1),
                (BLOCK as u32, 1, 1),
                0,
                self.queue(),
                &mut words,
            )
        }
        .map_err(|e| self.failure(kernel, &e))
    }

    fn multiply(&self, product: &Product) -> Result<(), DeviceError> {
        let operation =
            |transposed: bool| if transposed { Operation::CUBLAS_OP_T } else { Operation::CUBLAS_OP_N };
        let [m, n, k] = product.size.map(|n| n as i32);
        let [a, b, c] = product.at;
        let [lda, ldb, ldc] = product.columns.map(|n| n as i32);
        let [next_a, next_b, next_c] = product.next.map(|n| n as i64);
        let [one, zero] = [1.0, 0.0];
        // SAFETY: the addresses are of `allocate`, with room for these sizes.
        unsafe {
            blas::dgemm_strided_batched(
                *self.blas.handle(),
                operation(product.transposed[0]),
                operation(product.transposed[1]),
                m,
                n,
                k,
                &raw const one,
                a as *const f64,
                lda,
                next_a,
                b as *const f64,
                ldb,
                next_b,
                &raw const zero,
                c as *mut f64,
                ldc,
                next_c,
                product.count as i32,
            )
        }
        .map_err(|e| self.failure("matrix product", &e))
    }
}
