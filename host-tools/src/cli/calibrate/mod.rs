//! `baliza calibrate`: finds the parameters of a site that good positions need.

mod path_loss;

super::commands! {
    /// Parameters of a site, from measurements at known points
    enum Arguments {
        PathLoss(path_loss),
    }
}
