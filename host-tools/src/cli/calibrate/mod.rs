//! `baliza calibrate`: what is to be known of a site before positions are good.

mod path_loss;

super::commands! {
    /// Parameters of a site, from measurements at known points
    enum Arguments {
        PathLoss(path_loss),
    }
}
