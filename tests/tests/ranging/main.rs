//! Ranging, whole: the complaints that users of other systems have, the figures that are promised, and the captures.

mod accuracy;
mod captures;
mod complaints;
mod fidelity;
mod listening;
mod motion;
mod rates;
mod reproducible;
