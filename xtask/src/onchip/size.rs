//! Code sizes: the difference between an image with a method and the same image without.

use anyhow::Result;
use positioning_core::Method;

use crate::firmware::inspect;
use crate::succeed;
use crate::toolchain::Toolchain;

/// Bytes of flash of every method, each with all that it calls.
pub struct Sizes {
    /// In the order of [`Method::ALL`]: in the plane, in space.
    each: Vec<[u64; 2]>,
    /// All methods in one image: in the plane, in space.
    all: [u64; 2],
}

impl Sizes {
    /// Links one image for each method, one for all, and one for none, in the plane and in space.
    ///
    /// # Errors
    /// An image cannot be built or read.
    pub fn measure(toolchain: &Toolchain) -> Result<Self> {
        let weigh =
            |methods: &str| -> Result<[u64; 2]> { Ok([weigh(toolchain, methods, 2)?, weigh(toolchain, methods, 3)?]) };
        let none = weigh("none")?;
        let more = |image: [u64; 2]| [image[0].saturating_sub(none[0]), image[1].saturating_sub(none[1])];
        let each =
            (0..Method::ALL.len()).map(|place| weigh(&place.to_string()).map(more)).collect::<Result<Vec<_>>>()?;
        Ok(Self { each, all: more(weigh("all")?) })
    }

    /// Bytes of one method; `None` where it is not in [`Method::ALL`].
    pub fn of(&self, method: Method, dims: usize) -> Option<u64> {
        let place = Method::ALL.iter().position(|&other| other == method)?;
        self.each.get(place).map(|sizes| sizes[dims - 2])
    }

    /// Bytes of all methods together.
    pub fn of_all(&self, dims: usize) -> u64 {
        self.all[dims - 2]
    }
}

/// Bytes of flash of the image that holds `methods` (see `onchip-bench/src/bin/size.rs`).
fn weigh(toolchain: &Toolchain, methods: &str, dims: usize) -> Result<u64> {
    let mut cargo = toolchain.cargo("build");
    cargo.env("ONCHIP_METHODS", methods).env("ONCHIP_DIMS", dims.to_string());
    succeed(cargo.args(["--quiet", "--package", "baliza-onchip-bench", "--bin", "size", "--features", "image"]))?;
    inspect::flash(&toolchain.binary("size"))
}
