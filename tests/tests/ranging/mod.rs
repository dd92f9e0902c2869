//! System tests of ranging: the complaints of users of other systems, the promised figures, and the captures.

mod accuracy;
mod advertised;
mod air;
mod captures;
mod complaints;
mod crowds;
mod fidelity;
mod keyed;
mod listening;
mod motion;
mod rates;
mod reproducible;
mod uplink;
