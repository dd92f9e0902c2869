//! A survey of fingerprints: from the adverts at a point to rows of `fingerprints.csv`, or the reasons why they are none.
//!
//! [`read_points`] says where to go; a [`Stay`] takes what a node hears there, in the node's own time, until it is long enough;
//! [`judge`] refuses what is biased; [`Book`] is the file, which only ever grows.

mod book;
mod guide;
mod judge;
mod points;
mod stay;

pub use book::Book;
pub use guide::{Guide, Person, Take, Typed, Visit, each_advert};
pub use judge::{Bias, judge};
pub use points::{Place, parse_point, read_points};
pub use stay::{Advert, Stay};
