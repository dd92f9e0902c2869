//! The pipe to the simulated world: QEMU's standard input and output, opened by semihosting.

use core::cell::{Cell, RefCell};

use critical_section::Mutex;
use qemu_link::{MAX_MESSAGE, Request, WorldAnswer};
use semihosting::fs::File;
use semihosting::io::{Read, Write};

use super::clock::{self, Pause};

/// The open pipe.
pub struct Pipe {
    to: File,
    from: File,
    buffer: [u8; MAX_MESSAGE],
}

/// The only pipe, and the flags of the last answer.
pub struct Shared {
    pipe: Mutex<RefCell<Option<Pipe>>>,
    flags: Mutex<Cell<u8>>,
}

/// The only pipe.
pub static PIPE: Shared = Shared { pipe: Mutex::new(RefCell::new(None)), flags: Mutex::new(Cell::new(0)) };

impl Shared {
    /// Opens the pipe, and calls `first` with it.
    pub fn open<R>(&self, first: impl FnOnce(&Self) -> R) -> R {
        let to = File::create(c"/dev/stdout").expect("QEMU's standard output is a pipe");
        let from = File::open(c"/dev/stdin").expect("QEMU's standard input is a pipe");
        critical_section::with(|token| {
            *self.pipe.borrow_ref_mut(token) = Some(Pipe { to, from, buffer: [0; MAX_MESSAGE] });
        });
        first(self)
    }

    /// Sends a request to the simulated world, and passes the answer to `take`.
    pub fn ask<R>(&self, request: Request<'_>, take: impl FnOnce(&WorldAnswer<'_>) -> R) -> R {
        let _pause = Pause::begin();
        let spent = clock::take_spent();
        critical_section::with(|token| {
            let mut pipe = self.pipe.borrow_ref_mut(token);
            let pipe = pipe.as_mut().expect("the pipe is open");
            let message = request.encode(spent).expect("requests are short");
            // The world has ended: the program ends too.
            if pipe.to.write_all(&message).is_err() {
                semihosting::process::exit(1);
            }
            let answer = pipe.read();
            self.flags.borrow(token).set(answer.flags);
            let result = take(&answer);
            clock::set(answer.now_ns);
            result
        })
    }

    /// Whether the last answer had this flag.
    pub fn says(&self, flag: u8) -> bool {
        critical_section::with(|token| self.flags.borrow(token).get() & flag != 0)
    }
}

impl Pipe {
    fn read(&mut self) -> WorldAnswer<'_> {
        let mut length = [0; 2];
        if self.from.read_exact(&mut length).is_err() {
            semihosting::process::exit(1);
        }
        let body = self.buffer.get_mut(..usize::from(u16::from_le_bytes(length))).expect("answers are short");
        if self.from.read_exact(body).is_err() {
            semihosting::process::exit(1);
        }
        WorldAnswer::decode(body).expect("the world answers")
    }
}
