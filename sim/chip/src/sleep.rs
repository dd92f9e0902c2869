//! The future that sleeps.

use crate::kernel::Key;
use crate::time::TrueTime;
use crate::world::World;
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

/// Waits until an instant of true time.
pub struct Sleep {
    world: World,
    until: TrueTime,
    armed: Option<Key>,
}

impl Sleep {
    pub(crate) fn new(world: World, until: TrueTime) -> Self {
        Self { world, until, armed: None }
    }
}

impl Future for Sleep {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let this = self.get_mut();
        let kernel = this.world.kernel();
        if kernel.now() >= this.until {
            if let Some(key) = this.armed.take() {
                kernel.disarm(key);
            }
            return Poll::Ready(());
        }
        match this.armed {
            Some(key) => kernel.retarget(key, cx.waker()),
            None => this.armed = Some(kernel.schedule_wake(this.until, cx.waker())),
        }
        Poll::Pending
    }
}

impl Drop for Sleep {
    fn drop(&mut self) {
        if let Some(key) = self.armed.take() {
            self.world.kernel().disarm(key);
        }
    }
}
