//! The memory of a board's program for the trained classifier, which lies in flash beside the record.

use embedded_storage::nor_flash::ReadNorFlash;
use positioning_core::nlos::NodeModel;
use static_cell::StaticCell;
use wire::config::{Board, MODEL_BYTES};

/// Memory for one classifier, for a `static`.
pub struct NlosModelStore {
    bytes: StaticCell<[u8; MODEL_BYTES]>,
    model: StaticCell<NodeModel>,
}

impl NlosModelStore {
    /// Empty.
    pub const fn new() -> Self {
        Self { bytes: StaticCell::new(), model: StaticCell::new() }
    }

    /// Loads the classifier from flash, once in a program's run. `None` if there is none or if it is not valid: the log
    /// then gives the reason, and received powers classify links instead.
    #[cold]
    pub fn fill(&'static self, flash: &mut impl ReadNorFlash, board: Board) -> Option<&'static NodeModel> {
        let bytes = self.bytes.init_with(|| [0; MODEL_BYTES]);
        // A node without a record has no classifier either.
        let found = wire::config::load_model(flash, board.pages().offsets, bytes).ok().flatten()?;
        match NodeModel::decode(found) {
            Ok((model, _)) => {
                let model: &_ = self.model.init(model);
                Some(model)
            }
            Err(fault) => {
                defmt::warn!("the classifier of line of sight beside the record is not used: {}", fault);
                None
            }
        }
    }
}

impl Default for NlosModelStore {
    fn default() -> Self {
        Self::new()
    }
}
