//! The operations that need no second compilation, and none where IDA does without.
//!
//! Those that write a number other than zero where zeros are keep to the length, so that the rest
//! of the last block stays zero.

use std::mem;
use std::rc::Rc;

use sundials_sys::{_generic_N_Vector_Ops, N_Vector, N_Vector_ID, N_Vector_ID_SUNDIALS_NVEC_CUSTOM, SUNComm, comm_no_mpi};

use super::super::{Content, allocate, free};
use super::{block_count, blocks, content, entry_count, written};
use crate::solver::kernels::LANES;

unsafe extern "C" fn vector_id(_: N_Vector) -> N_Vector_ID {
    N_Vector_ID_SUNDIALS_NVEC_CUSTOM
}

unsafe extern "C" fn clone(x: N_Vector) -> N_Vector {
    // SAFETY: a vector of ours, whose table the new one gets too.
    unsafe {
        let Content { length, ref context, ref shared, .. } = *content(x);
        allocate(Content::new(length, context.clone(), shared.as_ref().map(Rc::clone)), (*x).ops)
    }
}

unsafe extern "C" fn destroy(x: N_Vector) {
    // SAFETY: SUNDIALS destroys what it has cloned, once.
    unsafe { free(x) }
}

/// Numbers and integers that a vector takes; IDA only adds them up, but asks for them
/// unconditionally.
unsafe extern "C" fn space(x: N_Vector, numbers: *mut i64, integers: *mut i64) {
    // SAFETY: a vector of ours, and variables of SUNDIALS.
    unsafe {
        *numbers = (block_count(x) * LANES) as i64;
        *integers = 1;
    }
}

unsafe extern "C" fn array_pointer(x: N_Vector) -> *mut f64 {
    // SAFETY: a vector of ours.
    unsafe { written(x).cast() }
}

unsafe extern "C" fn length(x: N_Vector) -> i64 {
    // SAFETY: a vector of ours.
    unsafe { entry_count(x) as i64 }
}

unsafe extern "C" fn communicator(_: N_Vector) -> SUNComm {
    comm_no_mpi()
}

unsafe extern "C" fn constant(c: f64, z: N_Vector) {
    // SAFETY: a vector of ours.
    unsafe { for_each(z, |_| c) };
}

unsafe extern "C" fn divide(x: N_Vector, y: N_Vector, z: N_Vector) {
    // SAFETY: vectors of one family, here and in the closure, which is called with numbers below
    // their length.
    unsafe { for_each(z, |i| entry(x, i) / entry(y, i)) };
}

unsafe extern "C" fn invert(x: N_Vector, z: N_Vector) {
    // SAFETY: as in `divide`.
    unsafe { for_each(z, |i| 1.0 / entry(x, i)) };
}

unsafe extern "C" fn add_constant(x: N_Vector, b: f64, z: N_Vector) {
    // SAFETY: as in `divide`.
    unsafe { for_each(z, |i| entry(x, i) + b) };
}

unsafe extern "C" fn minimum(x: N_Vector) -> f64 {
    // SAFETY: a vector of ours, which no code writes during the call.
    unsafe { &*content(x) }.entries().iter().fold(f64::MAX, |least, &value| least.min(value))
}

/// Weighted root mean square over the entries whose mask is positive.
unsafe extern "C" fn masked_norm(x: N_Vector, w: N_Vector, mask: N_Vector) -> f64 {
    // SAFETY: vectors of ours, which no code writes during the call.
    let (x, w, mask) = unsafe { (&*content(x), &*content(w), &*content(mask)) };
    let terms = x.entries().iter().zip(w.entries()).zip(mask.entries()).filter(|&(_, &counts)| counts > 0.0);
    let (sum, count) = terms.fold((0.0, 0.0_f64), |(sum, count), ((x, w), _)| (sum + (x * w) * (x * w), count + 1.0));
    (sum / count.max(1.0)).sqrt()
}

unsafe extern "C" fn maximum_norm(x: N_Vector) -> f64 {
    // SAFETY: a vector of ours, which no code writes during the call.
    unsafe { &*content(x) }.entries().iter().fold(0.0, |most: f64, value| most.max(value.abs()))
}

/// An entry.
///
/// # Safety
/// The vector is one of ours and has such an entry.
unsafe fn entry(x: N_Vector, i: usize) -> f64 {
    // SAFETY: by the contract.
    unsafe { *blocks(x).cast::<f64>().add(i) }
}

/// Sets every entry.
///
/// # Safety
/// The vector is one of ours.
unsafe fn for_each(z: N_Vector, value: impl Fn(usize) -> f64) {
    // SAFETY: by the contract; `i` stays below the length.
    unsafe {
        let to = written(z).cast::<f64>();
        for i in 0..entry_count(z) {
            *to.add(i) = value(i);
        }
    }
}

pub(super) const COMMON: _generic_N_Vector_Ops = _generic_N_Vector_Ops {
    nvgetvectorid: Some(vector_id),
    nvclone: Some(clone),
    nvdestroy: Some(destroy),
    nvspace: Some(space),
    nvgetarraypointer: Some(array_pointer),
    nvgetcommunicator: Some(communicator),
    nvgetlength: Some(length),
    nvconst: Some(constant),
    nvdiv: Some(divide),
    nvinv: Some(invert),
    nvaddconst: Some(add_constant),
    nvmin: Some(minimum),
    nvwrmsnormmask: Some(masked_norm),
    nvmaxnorm: Some(maximum_norm),
    // SAFETY: every other field is an optional function pointer, for which all zeros mean `None`.
    ..unsafe { mem::zeroed() }
};
