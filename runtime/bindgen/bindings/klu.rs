#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct klu_symbolic {
    pub symmetry: f64,
    pub est_flops: f64,
    pub lnz: f64,
    pub unz: f64,
    pub Lnz: *mut f64,
    pub n: ::std::os::raw::c_int,
    pub nz: ::std::os::raw::c_int,
    pub P: *mut ::std::os::raw::c_int,
    pub Q: *mut ::std::os::raw::c_int,
    pub R: *mut ::std::os::raw::c_int,
    pub nzoff: ::std::os::raw::c_int,
    pub nblocks: ::std::os::raw::c_int,
    pub maxblock: ::std::os::raw::c_int,
    pub ordering: ::std::os::raw::c_int,
    pub do_btf: ::std::os::raw::c_int,
    pub structural_rank: ::std::os::raw::c_int,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of klu_symbolic"][::std::mem::size_of::<klu_symbolic>() - 96usize];
    ["Alignment of klu_symbolic"][::std::mem::align_of::<klu_symbolic>() - 8usize];
    ["Offset of field: klu_symbolic::symmetry"][::std::mem::offset_of!(klu_symbolic, symmetry) - 0usize];
    ["Offset of field: klu_symbolic::est_flops"][::std::mem::offset_of!(klu_symbolic, est_flops) - 8usize];
    ["Offset of field: klu_symbolic::lnz"][::std::mem::offset_of!(klu_symbolic, lnz) - 16usize];
    ["Offset of field: klu_symbolic::unz"][::std::mem::offset_of!(klu_symbolic, unz) - 24usize];
    ["Offset of field: klu_symbolic::Lnz"][::std::mem::offset_of!(klu_symbolic, Lnz) - 32usize];
    ["Offset of field: klu_symbolic::n"][::std::mem::offset_of!(klu_symbolic, n) - 40usize];
    ["Offset of field: klu_symbolic::nz"][::std::mem::offset_of!(klu_symbolic, nz) - 44usize];
    ["Offset of field: klu_symbolic::P"][::std::mem::offset_of!(klu_symbolic, P) - 48usize];
    ["Offset of field: klu_symbolic::Q"][::std::mem::offset_of!(klu_symbolic, Q) - 56usize];
    ["Offset of field: klu_symbolic::R"][::std::mem::offset_of!(klu_symbolic, R) - 64usize];
    ["Offset of field: klu_symbolic::nzoff"][::std::mem::offset_of!(klu_symbolic, nzoff) - 72usize];
    ["Offset of field: klu_symbolic::nblocks"][::std::mem::offset_of!(klu_symbolic, nblocks) - 76usize];
    ["Offset of field: klu_symbolic::maxblock"][::std::mem::offset_of!(klu_symbolic, maxblock) - 80usize];
    ["Offset of field: klu_symbolic::ordering"][::std::mem::offset_of!(klu_symbolic, ordering) - 84usize];
    ["Offset of field: klu_symbolic::do_btf"][::std::mem::offset_of!(klu_symbolic, do_btf) - 88usize];
    ["Offset of field: klu_symbolic::structural_rank"][::std::mem::offset_of!(klu_symbolic, structural_rank) - 92usize];
};
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct klu_l_symbolic {
    pub symmetry: f64,
    pub est_flops: f64,
    pub lnz: f64,
    pub unz: f64,
    pub Lnz: *mut f64,
    pub n: ::std::os::raw::c_long,
    pub nz: ::std::os::raw::c_long,
    pub P: *mut ::std::os::raw::c_long,
    pub Q: *mut ::std::os::raw::c_long,
    pub R: *mut ::std::os::raw::c_long,
    pub nzoff: ::std::os::raw::c_long,
    pub nblocks: ::std::os::raw::c_long,
    pub maxblock: ::std::os::raw::c_long,
    pub ordering: ::std::os::raw::c_long,
    pub do_btf: ::std::os::raw::c_long,
    pub structural_rank: ::std::os::raw::c_long,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of klu_l_symbolic"][::std::mem::size_of::<klu_l_symbolic>() - 128usize];
    ["Alignment of klu_l_symbolic"][::std::mem::align_of::<klu_l_symbolic>() - 8usize];
    ["Offset of field: klu_l_symbolic::symmetry"][::std::mem::offset_of!(klu_l_symbolic, symmetry) - 0usize];
    ["Offset of field: klu_l_symbolic::est_flops"][::std::mem::offset_of!(klu_l_symbolic, est_flops) - 8usize];
    ["Offset of field: klu_l_symbolic::lnz"][::std::mem::offset_of!(klu_l_symbolic, lnz) - 16usize];
    ["Offset of field: klu_l_symbolic::unz"][::std::mem::offset_of!(klu_l_symbolic, unz) - 24usize];
    ["Offset of field: klu_l_symbolic::Lnz"][::std::mem::offset_of!(klu_l_symbolic, Lnz) - 32usize];
    ["Offset of field: klu_l_symbolic::n"][::std::mem::offset_of!(klu_l_symbolic, n) - 40usize];
    ["Offset of field: klu_l_symbolic::nz"][::std::mem::offset_of!(klu_l_symbolic, nz) - 48usize];
    ["Offset of field: klu_l_symbolic::P"][::std::mem::offset_of!(klu_l_symbolic, P) - 56usize];
    ["Offset of field: klu_l_symbolic::Q"][::std::mem::offset_of!(klu_l_symbolic, Q) - 64usize];
    ["Offset of field: klu_l_symbolic::R"][::std::mem::offset_of!(klu_l_symbolic, R) - 72usize];
    ["Offset of field: klu_l_symbolic::nzoff"][::std::mem::offset_of!(klu_l_symbolic, nzoff) - 80usize];
    ["Offset of field: klu_l_symbolic::nblocks"][::std::mem::offset_of!(klu_l_symbolic, nblocks) - 88usize];
    ["Offset of field: klu_l_symbolic::maxblock"][::std::mem::offset_of!(klu_l_symbolic, maxblock) - 96usize];
    ["Offset of field: klu_l_symbolic::ordering"][::std::mem::offset_of!(klu_l_symbolic, ordering) - 104usize];
    ["Offset of field: klu_l_symbolic::do_btf"][::std::mem::offset_of!(klu_l_symbolic, do_btf) - 112usize];
    ["Offset of field: klu_l_symbolic::structural_rank"][::std::mem::offset_of!(klu_l_symbolic, structural_rank) - 120usize];
};
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct klu_numeric {
    pub n: ::std::os::raw::c_int,
    pub nblocks: ::std::os::raw::c_int,
    pub lnz: ::std::os::raw::c_int,
    pub unz: ::std::os::raw::c_int,
    pub max_lnz_block: ::std::os::raw::c_int,
    pub max_unz_block: ::std::os::raw::c_int,
    pub Pnum: *mut ::std::os::raw::c_int,
    pub Pinv: *mut ::std::os::raw::c_int,
    pub Lip: *mut ::std::os::raw::c_int,
    pub Uip: *mut ::std::os::raw::c_int,
    pub Llen: *mut ::std::os::raw::c_int,
    pub Ulen: *mut ::std::os::raw::c_int,
    pub LUbx: *mut *mut ::std::os::raw::c_void,
    pub LUsize: *mut usize,
    pub Udiag: *mut ::std::os::raw::c_void,
    pub Rs: *mut f64,
    pub worksize: usize,
    pub Work: *mut ::std::os::raw::c_void,
    pub Xwork: *mut ::std::os::raw::c_void,
    pub Iwork: *mut ::std::os::raw::c_int,
    pub Offp: *mut ::std::os::raw::c_int,
    pub Offi: *mut ::std::os::raw::c_int,
    pub Offx: *mut ::std::os::raw::c_void,
    pub nzoff: ::std::os::raw::c_int,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of klu_numeric"][::std::mem::size_of::<klu_numeric>() - 168usize];
    ["Alignment of klu_numeric"][::std::mem::align_of::<klu_numeric>() - 8usize];
    ["Offset of field: klu_numeric::n"][::std::mem::offset_of!(klu_numeric, n) - 0usize];
    ["Offset of field: klu_numeric::nblocks"][::std::mem::offset_of!(klu_numeric, nblocks) - 4usize];
    ["Offset of field: klu_numeric::lnz"][::std::mem::offset_of!(klu_numeric, lnz) - 8usize];
    ["Offset of field: klu_numeric::unz"][::std::mem::offset_of!(klu_numeric, unz) - 12usize];
    ["Offset of field: klu_numeric::max_lnz_block"][::std::mem::offset_of!(klu_numeric, max_lnz_block) - 16usize];
    ["Offset of field: klu_numeric::max_unz_block"][::std::mem::offset_of!(klu_numeric, max_unz_block) - 20usize];
    ["Offset of field: klu_numeric::Pnum"][::std::mem::offset_of!(klu_numeric, Pnum) - 24usize];
    ["Offset of field: klu_numeric::Pinv"][::std::mem::offset_of!(klu_numeric, Pinv) - 32usize];
    ["Offset of field: klu_numeric::Lip"][::std::mem::offset_of!(klu_numeric, Lip) - 40usize];
    ["Offset of field: klu_numeric::Uip"][::std::mem::offset_of!(klu_numeric, Uip) - 48usize];
    ["Offset of field: klu_numeric::Llen"][::std::mem::offset_of!(klu_numeric, Llen) - 56usize];
    ["Offset of field: klu_numeric::Ulen"][::std::mem::offset_of!(klu_numeric, Ulen) - 64usize];
    ["Offset of field: klu_numeric::LUbx"][::std::mem::offset_of!(klu_numeric, LUbx) - 72usize];
    ["Offset of field: klu_numeric::LUsize"][::std::mem::offset_of!(klu_numeric, LUsize) - 80usize];
    ["Offset of field: klu_numeric::Udiag"][::std::mem::offset_of!(klu_numeric, Udiag) - 88usize];
    ["Offset of field: klu_numeric::Rs"][::std::mem::offset_of!(klu_numeric, Rs) - 96usize];
    ["Offset of field: klu_numeric::worksize"][::std::mem::offset_of!(klu_numeric, worksize) - 104usize];
    ["Offset of field: klu_numeric::Work"][::std::mem::offset_of!(klu_numeric, Work) - 112usize];
    ["Offset of field: klu_numeric::Xwork"][::std::mem::offset_of!(klu_numeric, Xwork) - 120usize];
    ["Offset of field: klu_numeric::Iwork"][::std::mem::offset_of!(klu_numeric, Iwork) - 128usize];
    ["Offset of field: klu_numeric::Offp"][::std::mem::offset_of!(klu_numeric, Offp) - 136usize];
    ["Offset of field: klu_numeric::Offi"][::std::mem::offset_of!(klu_numeric, Offi) - 144usize];
    ["Offset of field: klu_numeric::Offx"][::std::mem::offset_of!(klu_numeric, Offx) - 152usize];
    ["Offset of field: klu_numeric::nzoff"][::std::mem::offset_of!(klu_numeric, nzoff) - 160usize];
};
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct klu_l_numeric {
    pub n: ::std::os::raw::c_long,
    pub nblocks: ::std::os::raw::c_long,
    pub lnz: ::std::os::raw::c_long,
    pub unz: ::std::os::raw::c_long,
    pub max_lnz_block: ::std::os::raw::c_long,
    pub max_unz_block: ::std::os::raw::c_long,
    pub Pnum: *mut ::std::os::raw::c_long,
    pub Pinv: *mut ::std::os::raw::c_long,
    pub Lip: *mut ::std::os::raw::c_long,
    pub Uip: *mut ::std::os::raw::c_long,
    pub Llen: *mut ::std::os::raw::c_long,
    pub Ulen: *mut ::std::os::raw::c_long,
    pub LUbx: *mut *mut ::std::os::raw::c_void,
    pub LUsize: *mut usize,
    pub Udiag: *mut ::std::os::raw::c_void,
    pub Rs: *mut f64,
    pub worksize: usize,
    pub Work: *mut ::std::os::raw::c_void,
    pub Xwork: *mut ::std::os::raw::c_void,
    pub Iwork: *mut ::std::os::raw::c_long,
    pub Offp: *mut ::std::os::raw::c_long,
    pub Offi: *mut ::std::os::raw::c_long,
    pub Offx: *mut ::std::os::raw::c_void,
    pub nzoff: ::std::os::raw::c_long,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of klu_l_numeric"][::std::mem::size_of::<klu_l_numeric>() - 192usize];
    ["Alignment of klu_l_numeric"][::std::mem::align_of::<klu_l_numeric>() - 8usize];
    ["Offset of field: klu_l_numeric::n"][::std::mem::offset_of!(klu_l_numeric, n) - 0usize];
    ["Offset of field: klu_l_numeric::nblocks"][::std::mem::offset_of!(klu_l_numeric, nblocks) - 8usize];
    ["Offset of field: klu_l_numeric::lnz"][::std::mem::offset_of!(klu_l_numeric, lnz) - 16usize];
    ["Offset of field: klu_l_numeric::unz"][::std::mem::offset_of!(klu_l_numeric, unz) - 24usize];
    ["Offset of field: klu_l_numeric::max_lnz_block"][::std::mem::offset_of!(klu_l_numeric, max_lnz_block) - 32usize];
    ["Offset of field: klu_l_numeric::max_unz_block"][::std::mem::offset_of!(klu_l_numeric, max_unz_block) - 40usize];
    ["Offset of field: klu_l_numeric::Pnum"][::std::mem::offset_of!(klu_l_numeric, Pnum) - 48usize];
    ["Offset of field: klu_l_numeric::Pinv"][::std::mem::offset_of!(klu_l_numeric, Pinv) - 56usize];
    ["Offset of field: klu_l_numeric::Lip"][::std::mem::offset_of!(klu_l_numeric, Lip) - 64usize];
    ["Offset of field: klu_l_numeric::Uip"][::std::mem::offset_of!(klu_l_numeric, Uip) - 72usize];
    ["Offset of field: klu_l_numeric::Llen"][::std::mem::offset_of!(klu_l_numeric, Llen) - 80usize];
    ["Offset of field: klu_l_numeric::Ulen"][::std::mem::offset_of!(klu_l_numeric, Ulen) - 88usize];
    ["Offset of field: klu_l_numeric::LUbx"][::std::mem::offset_of!(klu_l_numeric, LUbx) - 96usize];
    ["Offset of field: klu_l_numeric::LUsize"][::std::mem::offset_of!(klu_l_numeric, LUsize) - 104usize];
    ["Offset of field: klu_l_numeric::Udiag"][::std::mem::offset_of!(klu_l_numeric, Udiag) - 112usize];
    ["Offset of field: klu_l_numeric::Rs"][::std::mem::offset_of!(klu_l_numeric, Rs) - 120usize];
    ["Offset of field: klu_l_numeric::worksize"][::std::mem::offset_of!(klu_l_numeric, worksize) - 128usize];
    ["Offset of field: klu_l_numeric::Work"][::std::mem::offset_of!(klu_l_numeric, Work) - 136usize];
    ["Offset of field: klu_l_numeric::Xwork"][::std::mem::offset_of!(klu_l_numeric, Xwork) - 144usize];
    ["Offset of field: klu_l_numeric::Iwork"][::std::mem::offset_of!(klu_l_numeric, Iwork) - 152usize];
    ["Offset of field: klu_l_numeric::Offp"][::std::mem::offset_of!(klu_l_numeric, Offp) - 160usize];
    ["Offset of field: klu_l_numeric::Offi"][::std::mem::offset_of!(klu_l_numeric, Offi) - 168usize];
    ["Offset of field: klu_l_numeric::Offx"][::std::mem::offset_of!(klu_l_numeric, Offx) - 176usize];
    ["Offset of field: klu_l_numeric::nzoff"][::std::mem::offset_of!(klu_l_numeric, nzoff) - 184usize];
};
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct klu_common_struct {
    pub tol: f64,
    pub memgrow: f64,
    pub initmem_amd: f64,
    pub initmem: f64,
    pub maxwork: f64,
    pub btf: ::std::os::raw::c_int,
    pub ordering: ::std::os::raw::c_int,
    pub scale: ::std::os::raw::c_int,
    pub user_order: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: ::std::os::raw::c_int,
            arg2: *mut ::std::os::raw::c_int,
            arg3: *mut ::std::os::raw::c_int,
            arg4: *mut ::std::os::raw::c_int,
            arg5: *mut klu_common_struct,
        ) -> ::std::os::raw::c_int,
    >,
    pub user_data: *mut ::std::os::raw::c_void,
    pub halt_if_singular: ::std::os::raw::c_int,
    pub status: ::std::os::raw::c_int,
    pub nrealloc: ::std::os::raw::c_int,
    pub structural_rank: ::std::os::raw::c_int,
    pub numerical_rank: ::std::os::raw::c_int,
    pub singular_col: ::std::os::raw::c_int,
    pub noffdiag: ::std::os::raw::c_int,
    pub flops: f64,
    pub rcond: f64,
    pub condest: f64,
    pub rgrowth: f64,
    pub work: f64,
    pub memusage: usize,
    pub mempeak: usize,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of klu_common_struct"][::std::mem::size_of::<klu_common_struct>() - 160usize];
    ["Alignment of klu_common_struct"][::std::mem::align_of::<klu_common_struct>() - 8usize];
    ["Offset of field: klu_common_struct::tol"][::std::mem::offset_of!(klu_common_struct, tol) - 0usize];
    ["Offset of field: klu_common_struct::memgrow"][::std::mem::offset_of!(klu_common_struct, memgrow) - 8usize];
    ["Offset of field: klu_common_struct::initmem_amd"][::std::mem::offset_of!(klu_common_struct, initmem_amd) - 16usize];
    ["Offset of field: klu_common_struct::initmem"][::std::mem::offset_of!(klu_common_struct, initmem) - 24usize];
    ["Offset of field: klu_common_struct::maxwork"][::std::mem::offset_of!(klu_common_struct, maxwork) - 32usize];
    ["Offset of field: klu_common_struct::btf"][::std::mem::offset_of!(klu_common_struct, btf) - 40usize];
    ["Offset of field: klu_common_struct::ordering"][::std::mem::offset_of!(klu_common_struct, ordering) - 44usize];
    ["Offset of field: klu_common_struct::scale"][::std::mem::offset_of!(klu_common_struct, scale) - 48usize];
    ["Offset of field: klu_common_struct::user_order"][::std::mem::offset_of!(klu_common_struct, user_order) - 56usize];
    ["Offset of field: klu_common_struct::user_data"][::std::mem::offset_of!(klu_common_struct, user_data) - 64usize];
    ["Offset of field: klu_common_struct::halt_if_singular"][::std::mem::offset_of!(klu_common_struct, halt_if_singular) - 72usize];
    ["Offset of field: klu_common_struct::status"][::std::mem::offset_of!(klu_common_struct, status) - 76usize];
    ["Offset of field: klu_common_struct::nrealloc"][::std::mem::offset_of!(klu_common_struct, nrealloc) - 80usize];
    ["Offset of field: klu_common_struct::structural_rank"][::std::mem::offset_of!(klu_common_struct, structural_rank) - 84usize];
    ["Offset of field: klu_common_struct::numerical_rank"][::std::mem::offset_of!(klu_common_struct, numerical_rank) - 88usize];
    ["Offset of field: klu_common_struct::singular_col"][::std::mem::offset_of!(klu_common_struct, singular_col) - 92usize];
    ["Offset of field: klu_common_struct::noffdiag"][::std::mem::offset_of!(klu_common_struct, noffdiag) - 96usize];
    ["Offset of field: klu_common_struct::flops"][::std::mem::offset_of!(klu_common_struct, flops) - 104usize];
    ["Offset of field: klu_common_struct::rcond"][::std::mem::offset_of!(klu_common_struct, rcond) - 112usize];
    ["Offset of field: klu_common_struct::condest"][::std::mem::offset_of!(klu_common_struct, condest) - 120usize];
    ["Offset of field: klu_common_struct::rgrowth"][::std::mem::offset_of!(klu_common_struct, rgrowth) - 128usize];
    ["Offset of field: klu_common_struct::work"][::std::mem::offset_of!(klu_common_struct, work) - 136usize];
    ["Offset of field: klu_common_struct::memusage"][::std::mem::offset_of!(klu_common_struct, memusage) - 144usize];
    ["Offset of field: klu_common_struct::mempeak"][::std::mem::offset_of!(klu_common_struct, mempeak) - 152usize];
};
pub type klu_common = klu_common_struct;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct klu_l_common_struct {
    pub tol: f64,
    pub memgrow: f64,
    pub initmem_amd: f64,
    pub initmem: f64,
    pub maxwork: f64,
    pub btf: ::std::os::raw::c_long,
    pub ordering: ::std::os::raw::c_long,
    pub scale: ::std::os::raw::c_long,
    pub user_order: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: ::std::os::raw::c_long,
            arg2: *mut ::std::os::raw::c_long,
            arg3: *mut ::std::os::raw::c_long,
            arg4: *mut ::std::os::raw::c_long,
            arg5: *mut klu_l_common_struct,
        ) -> ::std::os::raw::c_long,
    >,
    pub user_data: *mut ::std::os::raw::c_void,
    pub halt_if_singular: ::std::os::raw::c_long,
    pub status: ::std::os::raw::c_long,
    pub nrealloc: ::std::os::raw::c_long,
    pub structural_rank: ::std::os::raw::c_long,
    pub numerical_rank: ::std::os::raw::c_long,
    pub singular_col: ::std::os::raw::c_long,
    pub noffdiag: ::std::os::raw::c_long,
    pub flops: f64,
    pub rcond: f64,
    pub condest: f64,
    pub rgrowth: f64,
    pub work: f64,
    pub memusage: usize,
    pub mempeak: usize,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of klu_l_common_struct"][::std::mem::size_of::<klu_l_common_struct>() - 192usize];
    ["Alignment of klu_l_common_struct"][::std::mem::align_of::<klu_l_common_struct>() - 8usize];
    ["Offset of field: klu_l_common_struct::tol"][::std::mem::offset_of!(klu_l_common_struct, tol) - 0usize];
    ["Offset of field: klu_l_common_struct::memgrow"][::std::mem::offset_of!(klu_l_common_struct, memgrow) - 8usize];
    ["Offset of field: klu_l_common_struct::initmem_amd"][::std::mem::offset_of!(klu_l_common_struct, initmem_amd) - 16usize];
    ["Offset of field: klu_l_common_struct::initmem"][::std::mem::offset_of!(klu_l_common_struct, initmem) - 24usize];
    ["Offset of field: klu_l_common_struct::maxwork"][::std::mem::offset_of!(klu_l_common_struct, maxwork) - 32usize];
    ["Offset of field: klu_l_common_struct::btf"][::std::mem::offset_of!(klu_l_common_struct, btf) - 40usize];
    ["Offset of field: klu_l_common_struct::ordering"][::std::mem::offset_of!(klu_l_common_struct, ordering) - 48usize];
    ["Offset of field: klu_l_common_struct::scale"][::std::mem::offset_of!(klu_l_common_struct, scale) - 56usize];
    ["Offset of field: klu_l_common_struct::user_order"][::std::mem::offset_of!(klu_l_common_struct, user_order) - 64usize];
    ["Offset of field: klu_l_common_struct::user_data"][::std::mem::offset_of!(klu_l_common_struct, user_data) - 72usize];
    ["Offset of field: klu_l_common_struct::halt_if_singular"][::std::mem::offset_of!(klu_l_common_struct, halt_if_singular) - 80usize];
    ["Offset of field: klu_l_common_struct::status"][::std::mem::offset_of!(klu_l_common_struct, status) - 88usize];
    ["Offset of field: klu_l_common_struct::nrealloc"][::std::mem::offset_of!(klu_l_common_struct, nrealloc) - 96usize];
    ["Offset of field: klu_l_common_struct::structural_rank"][::std::mem::offset_of!(klu_l_common_struct, structural_rank) - 104usize];
    ["Offset of field: klu_l_common_struct::numerical_rank"][::std::mem::offset_of!(klu_l_common_struct, numerical_rank) - 112usize];
    ["Offset of field: klu_l_common_struct::singular_col"][::std::mem::offset_of!(klu_l_common_struct, singular_col) - 120usize];
    ["Offset of field: klu_l_common_struct::noffdiag"][::std::mem::offset_of!(klu_l_common_struct, noffdiag) - 128usize];
    ["Offset of field: klu_l_common_struct::flops"][::std::mem::offset_of!(klu_l_common_struct, flops) - 136usize];
    ["Offset of field: klu_l_common_struct::rcond"][::std::mem::offset_of!(klu_l_common_struct, rcond) - 144usize];
    ["Offset of field: klu_l_common_struct::condest"][::std::mem::offset_of!(klu_l_common_struct, condest) - 152usize];
    ["Offset of field: klu_l_common_struct::rgrowth"][::std::mem::offset_of!(klu_l_common_struct, rgrowth) - 160usize];
    ["Offset of field: klu_l_common_struct::work"][::std::mem::offset_of!(klu_l_common_struct, work) - 168usize];
    ["Offset of field: klu_l_common_struct::memusage"][::std::mem::offset_of!(klu_l_common_struct, memusage) - 176usize];
    ["Offset of field: klu_l_common_struct::mempeak"][::std::mem::offset_of!(klu_l_common_struct, mempeak) - 184usize];
};
pub type klu_l_common = klu_l_common_struct;
