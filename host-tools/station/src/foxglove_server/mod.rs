//! `--foxglove`: a server that lets Foxglove draw all tags of a site live, with and without the feature of this name.

#[cfg(feature = "foxglove")]
mod with;
#[cfg(not(feature = "foxglove"))]
mod without;

#[cfg(feature = "foxglove")]
pub use with::FoxgloveServer;
#[cfg(not(feature = "foxglove"))]
pub use without::FoxgloveServer;
