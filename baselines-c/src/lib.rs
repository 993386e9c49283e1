//! Controllers for programs in C: `include/rodgym_controllers.h` says what each function does.
//!
//! A controller is read from the bytes that `controller.save` of the Python package wrote, or designed here, once, where memory
//! may be taken. From then on it never changes: its memory of an episode is an array of the caller's, and a step reads an
//! array, writes two, and takes no memory.
//!
//! No panic crosses the border (`border.rs`), and what is refused has a code and a sentence.

mod border;
mod design;
mod play;

pub use border::Status;
pub use design::Handle;
pub use play::Quantity;
