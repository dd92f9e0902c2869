//! `baliza calibrate`: finds the parameters of a site that good positions need.

mod antenna_delay;
mod path_loss;

super::commands! {
    /// Parameters of a site, from measurements at known points
    pub enum Arguments {
        AntennaDelay(antenna_delay),
        PathLoss(path_loss),
    }
}
