//! Which vector instructions the lanes use, chosen when the program runs.
//!
//! The physics is compiled once for each number type from the same generic source: `with_lanes` names the type, and
//! `Real::run` runs a kernel with that type's instructions. Results do not depend on the choice (no fused or approximate
//! operation is used).

use crate::error::{Error, Result};
#[cfg(target_arch = "x86_64")]
use crate::lane::x86::{Avx2, Avx512};
use crate::lane::{Lanes, Real};
use std::sync::OnceLock;

/// An instruction set for the lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// What every processor of the target has (SSE2 on x86-64, NEON on AArch64).
    Baseline,
    /// 256-bit vectors (x86-64 only).
    Avx2,
    /// 512-bit vectors (x86-64 only).
    Avx512,
}

impl Isa {
    /// Name as used in the environment variable `RODGYM_ISA` and in `rodgym bench`.
    pub fn name(self) -> &'static str {
        match self {
            Isa::Baseline => "baseline",
            Isa::Avx2 => "avx2",
            Isa::Avx512 => "avx512",
        }
    }

    /// Instruction sets that this machine can run, slowest first.
    pub fn available() -> Vec<Isa> {
        let mut found = vec![Isa::Baseline];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") {
                found.push(Isa::Avx2);
            }
            if has_avx512() {
                found.push(Isa::Avx512);
            }
        }
        found
    }

    /// The set in use: the fastest available one, or the one that the environment variable `RODGYM_ISA` names.
    /// Read once, at first use.
    ///
    /// # Errors
    /// A name in `RODGYM_ISA` that is not one of an available set.
    pub fn current() -> Result<Isa> {
        static CHOICE: OnceLock<Result<Isa>> = OnceLock::new();
        let choose = || Isa::named(&std::env::var("RODGYM_ISA").unwrap_or_default());
        CHOICE.get_or_init(choose).clone()
    }

    /// The available set of that name; the fastest one for no name at all.
    fn named(name: &str) -> Result<Isa> {
        let available = Isa::available();
        if name.is_empty() {
            return Ok(*available.last().expect("the baseline is always there"));
        }
        available.iter().copied().find(|isa| isa.name() == name).ok_or_else(|| {
            let names: Vec<_> = available.iter().map(|isa| format!("'{}'", isa.name())).collect();
            let allowed = format!("one of {} on this machine, or unset", names.join(", "));
            Error::parameter("RODGYM_ISA", name, allowed)
        })
    }
}

/// Whether every feature that kernels of `Avx512` are compiled for is there.
#[cfg(target_arch = "x86_64")]
fn has_avx512() -> bool {
    is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512bw")
}

/// Something to be made for one of the number types that stand for eight environments.
pub trait ForLanes {
    /// What is made.
    type Output;
    /// Makes it for numbers of type `R`.
    fn make<R: Real>(self) -> Self::Output;
}

/// Makes something for the number type that suits the instruction set.
///
/// # Panics
/// When this machine lacks the instruction set.
pub fn with_lanes<T: ForLanes>(isa: Isa, what: T) -> T::Output {
    assert!(Isa::available().contains(&isa), "this machine has no {}", isa.name());
    match isa {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => what.make::<Avx512>(),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => what.make::<Avx2>(),
        _ => what.make::<Lanes<8>>(),
    }
}
