//! Memory for an anchor's large tables. A node lends it from a `static`, because its stack has no room to make them on.

#[cfg(not(target_os = "none"))]
use alloc::boxed::Box;
use core::ops::{Deref, DerefMut};

use heapless::{Vec, VecView};

use super::anchor_table::AnchorTable;
use super::lease_entry::Entry;

/// Memory for the tables of an anchor that knows up to `LEASES` leases, 12 bytes each. An anchor serves as many tags.
#[derive(Debug)]
pub struct AnchorMemory<const LEASES: usize> {
    leases: Vec<Entry, LEASES>,
    anchors: AnchorTable,
}

impl<const LEASES: usize> AnchorMemory<LEASES> {
    /// Empty memory, all zero.
    pub const fn new() -> Self {
        Self { leases: Vec::new(), anchors: AnchorTable::new() }
    }
}

impl<const LEASES: usize> Default for AnchorMemory<LEASES> {
    fn default() -> Self {
        Self::new()
    }
}

/// The tables of one anchor.
#[derive(Debug)]
#[cfg_attr(not(target_os = "none"), derive(Clone))]
pub struct AnchorTables<'m> {
    pub(super) leases: Table<'m, VecView<Entry>>,
    pub(super) anchors: Table<'m, AnchorTable>,
}

impl<'m, const LEASES: usize> From<&'m mut AnchorMemory<LEASES>> for AnchorTables<'m> {
    fn from(memory: &'m mut AnchorMemory<LEASES>) -> Self {
        Self { leases: Table::Lent(&mut memory.leases), anchors: Table::Lent(&mut memory.anchors) }
    }
}

/// A large table.
#[derive(Debug)]
pub enum Table<'m, T: ?Sized> {
    /// In memory that a node has lent.
    Lent(&'m mut T),
    /// In memory of its own.
    #[cfg(not(target_os = "none"))]
    Own(Box<T>),
}

impl<T: ?Sized> Deref for Table<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        match self {
            Self::Lent(table) => table,
            #[cfg(not(target_os = "none"))]
            Self::Own(table) => table,
        }
    }
}

impl<T: ?Sized> DerefMut for Table<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        match self {
            Self::Lent(table) => table,
            #[cfg(not(target_os = "none"))]
            Self::Own(table) => table,
        }
    }
}

/// On a computer, anchors may have tables of their own.
#[cfg(not(target_os = "none"))]
mod own {
    use super::{AnchorTable, AnchorTables, Box, Entry, Table, Vec, VecView};

    type Leases = Vec<Entry, 1024>;

    /// Tables for 1,024 leases.
    impl Default for AnchorTables<'_> {
        fn default() -> Self {
            Self { leases: Table::Own(Box::<Leases>::default()), anchors: Table::Own(Box::default()) }
        }
    }

    impl Clone for Table<'_, VecView<Entry>> {
        fn clone(&self) -> Self {
            Self::Own(Box::new(self.iter().copied().collect::<Leases>()))
        }
    }

    impl Clone for Table<'_, AnchorTable> {
        fn clone(&self) -> Self {
            Self::Own(Box::new((**self).clone()))
        }
    }
}
