pub const SUNDIALS_VERSION_MAJOR: ::std::os::raw::c_int = 6;
pub const SUNDIALS_VERSION_MINOR: ::std::os::raw::c_int = 4;
pub const SUNDIALS_VERSION_PATCH: ::std::os::raw::c_int = 1;
pub const SUNDIALS_VERSION_LABEL: &[u8; 1] = b"\0";
pub const SUN_NLS_CONV_RECVR: ::std::os::raw::c_int = 902;
pub const IDA_NORMAL: ::std::os::raw::c_int = 1;
pub const IDA_ONE_STEP: ::std::os::raw::c_int = 2;
pub const IDA_YA_YDP_INIT: ::std::os::raw::c_int = 1;
pub const IDA_SUCCESS: ::std::os::raw::c_int = 0;
pub const IDA_TSTOP_RETURN: ::std::os::raw::c_int = 1;
pub const IDA_TOO_MUCH_WORK: ::std::os::raw::c_int = -1;
pub const IDA_ERR_FAIL: ::std::os::raw::c_int = -3;
pub const IDA_CONV_FAIL: ::std::os::raw::c_int = -4;
pub const IDA_REP_RES_ERR: ::std::os::raw::c_int = -9;
pub type __off_t = ::std::os::raw::c_long;
pub type __off64_t = ::std::os::raw::c_long;
pub type FILE = _IO_FILE;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _IO_marker {
    _unused: [u8; 0],
}
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _IO_codecvt {
    _unused: [u8; 0],
}
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _IO_wide_data {
    _unused: [u8; 0],
}
pub type _IO_lock_t = ::std::os::raw::c_void;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _IO_FILE {
    pub _flags: ::std::os::raw::c_int,
    pub _IO_read_ptr: *mut ::std::os::raw::c_char,
    pub _IO_read_end: *mut ::std::os::raw::c_char,
    pub _IO_read_base: *mut ::std::os::raw::c_char,
    pub _IO_write_base: *mut ::std::os::raw::c_char,
    pub _IO_write_ptr: *mut ::std::os::raw::c_char,
    pub _IO_write_end: *mut ::std::os::raw::c_char,
    pub _IO_buf_base: *mut ::std::os::raw::c_char,
    pub _IO_buf_end: *mut ::std::os::raw::c_char,
    pub _IO_save_base: *mut ::std::os::raw::c_char,
    pub _IO_backup_base: *mut ::std::os::raw::c_char,
    pub _IO_save_end: *mut ::std::os::raw::c_char,
    pub _markers: *mut _IO_marker,
    pub _chain: *mut _IO_FILE,
    pub _fileno: ::std::os::raw::c_int,
    pub _flags2: ::std::os::raw::c_int,
    pub _old_offset: __off_t,
    pub _cur_column: ::std::os::raw::c_ushort,
    pub _vtable_offset: ::std::os::raw::c_schar,
    pub _shortbuf: [::std::os::raw::c_char; 1usize],
    pub _lock: *mut _IO_lock_t,
    pub _offset: __off64_t,
    pub _codecvt: *mut _IO_codecvt,
    pub _wide_data: *mut _IO_wide_data,
    pub _freeres_list: *mut _IO_FILE,
    pub _freeres_buf: *mut ::std::os::raw::c_void,
    pub __pad5: usize,
    pub _mode: ::std::os::raw::c_int,
    pub _unused2: [::std::os::raw::c_char; 20usize],
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of _IO_FILE"][::std::mem::size_of::<_IO_FILE>() - 216usize];
    ["Alignment of _IO_FILE"][::std::mem::align_of::<_IO_FILE>() - 8usize];
    ["Offset of field: _IO_FILE::_flags"][::std::mem::offset_of!(_IO_FILE, _flags) - 0usize];
    ["Offset of field: _IO_FILE::_IO_read_ptr"][::std::mem::offset_of!(_IO_FILE, _IO_read_ptr) - 8usize];
    ["Offset of field: _IO_FILE::_IO_read_end"][::std::mem::offset_of!(_IO_FILE, _IO_read_end) - 16usize];
    ["Offset of field: _IO_FILE::_IO_read_base"][::std::mem::offset_of!(_IO_FILE, _IO_read_base) - 24usize];
    ["Offset of field: _IO_FILE::_IO_write_base"][::std::mem::offset_of!(_IO_FILE, _IO_write_base) - 32usize];
    ["Offset of field: _IO_FILE::_IO_write_ptr"][::std::mem::offset_of!(_IO_FILE, _IO_write_ptr) - 40usize];
    ["Offset of field: _IO_FILE::_IO_write_end"][::std::mem::offset_of!(_IO_FILE, _IO_write_end) - 48usize];
    ["Offset of field: _IO_FILE::_IO_buf_base"][::std::mem::offset_of!(_IO_FILE, _IO_buf_base) - 56usize];
    ["Offset of field: _IO_FILE::_IO_buf_end"][::std::mem::offset_of!(_IO_FILE, _IO_buf_end) - 64usize];
    ["Offset of field: _IO_FILE::_IO_save_base"][::std::mem::offset_of!(_IO_FILE, _IO_save_base) - 72usize];
    ["Offset of field: _IO_FILE::_IO_backup_base"][::std::mem::offset_of!(_IO_FILE, _IO_backup_base) - 80usize];
    ["Offset of field: _IO_FILE::_IO_save_end"][::std::mem::offset_of!(_IO_FILE, _IO_save_end) - 88usize];
    ["Offset of field: _IO_FILE::_markers"][::std::mem::offset_of!(_IO_FILE, _markers) - 96usize];
    ["Offset of field: _IO_FILE::_chain"][::std::mem::offset_of!(_IO_FILE, _chain) - 104usize];
    ["Offset of field: _IO_FILE::_fileno"][::std::mem::offset_of!(_IO_FILE, _fileno) - 112usize];
    ["Offset of field: _IO_FILE::_flags2"][::std::mem::offset_of!(_IO_FILE, _flags2) - 116usize];
    ["Offset of field: _IO_FILE::_old_offset"][::std::mem::offset_of!(_IO_FILE, _old_offset) - 120usize];
    ["Offset of field: _IO_FILE::_cur_column"][::std::mem::offset_of!(_IO_FILE, _cur_column) - 128usize];
    ["Offset of field: _IO_FILE::_vtable_offset"][::std::mem::offset_of!(_IO_FILE, _vtable_offset) - 130usize];
    ["Offset of field: _IO_FILE::_shortbuf"][::std::mem::offset_of!(_IO_FILE, _shortbuf) - 131usize];
    ["Offset of field: _IO_FILE::_lock"][::std::mem::offset_of!(_IO_FILE, _lock) - 136usize];
    ["Offset of field: _IO_FILE::_offset"][::std::mem::offset_of!(_IO_FILE, _offset) - 144usize];
    ["Offset of field: _IO_FILE::_codecvt"][::std::mem::offset_of!(_IO_FILE, _codecvt) - 152usize];
    ["Offset of field: _IO_FILE::_wide_data"][::std::mem::offset_of!(_IO_FILE, _wide_data) - 160usize];
    ["Offset of field: _IO_FILE::_freeres_list"][::std::mem::offset_of!(_IO_FILE, _freeres_list) - 168usize];
    ["Offset of field: _IO_FILE::_freeres_buf"][::std::mem::offset_of!(_IO_FILE, _freeres_buf) - 176usize];
    ["Offset of field: _IO_FILE::__pad5"][::std::mem::offset_of!(_IO_FILE, __pad5) - 184usize];
    ["Offset of field: _IO_FILE::_mode"][::std::mem::offset_of!(_IO_FILE, _mode) - 192usize];
    ["Offset of field: _IO_FILE::_unused2"][::std::mem::offset_of!(_IO_FILE, _unused2) - 196usize];
};
pub type realtype = f64;
pub type sunrealtype = f64;
pub type sunindextype = i64;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _SUNContext {
    _unused: [u8; 0],
}
pub type SUNContext = *mut _SUNContext;
unsafe extern "C" {
    pub fn SUNContext_Create(comm: *mut ::std::os::raw::c_void, ctx: *mut SUNContext) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn SUNContext_Free(ctx: *mut SUNContext) -> ::std::os::raw::c_int;
}
pub const N_Vector_ID_SUNDIALS_NVEC_SERIAL: N_Vector_ID = 0;
pub const N_Vector_ID_SUNDIALS_NVEC_PARALLEL: N_Vector_ID = 1;
pub const N_Vector_ID_SUNDIALS_NVEC_OPENMP: N_Vector_ID = 2;
pub const N_Vector_ID_SUNDIALS_NVEC_PTHREADS: N_Vector_ID = 3;
pub const N_Vector_ID_SUNDIALS_NVEC_PARHYP: N_Vector_ID = 4;
pub const N_Vector_ID_SUNDIALS_NVEC_PETSC: N_Vector_ID = 5;
pub const N_Vector_ID_SUNDIALS_NVEC_CUDA: N_Vector_ID = 6;
pub const N_Vector_ID_SUNDIALS_NVEC_HIP: N_Vector_ID = 7;
pub const N_Vector_ID_SUNDIALS_NVEC_SYCL: N_Vector_ID = 8;
pub const N_Vector_ID_SUNDIALS_NVEC_RAJA: N_Vector_ID = 9;
pub const N_Vector_ID_SUNDIALS_NVEC_KOKKOS: N_Vector_ID = 10;
pub const N_Vector_ID_SUNDIALS_NVEC_OPENMPDEV: N_Vector_ID = 11;
pub const N_Vector_ID_SUNDIALS_NVEC_TRILINOS: N_Vector_ID = 12;
pub const N_Vector_ID_SUNDIALS_NVEC_MANYVECTOR: N_Vector_ID = 13;
pub const N_Vector_ID_SUNDIALS_NVEC_MPIMANYVECTOR: N_Vector_ID = 14;
pub const N_Vector_ID_SUNDIALS_NVEC_MPIPLUSX: N_Vector_ID = 15;
pub const N_Vector_ID_SUNDIALS_NVEC_CUSTOM: N_Vector_ID = 16;
pub type N_Vector_ID = ::std::os::raw::c_uint;
pub type N_Vector_Ops = *mut _generic_N_Vector_Ops;
pub type N_Vector = *mut _generic_N_Vector;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _generic_N_Vector_Ops {
    pub nvgetvectorid: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector) -> N_Vector_ID>,
    pub nvclone: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector) -> N_Vector>,
    pub nvcloneempty: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector) -> N_Vector>,
    pub nvdestroy: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector)>,
    pub nvspace: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: *mut sunindextype, arg3: *mut sunindextype)>,
    pub nvgetarraypointer: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector) -> *mut realtype>,
    pub nvgetdevicearraypointer: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector) -> *mut realtype>,
    pub nvsetarraypointer: ::std::option::Option<unsafe extern "C" fn(arg1: *mut realtype, arg2: N_Vector)>,
    pub nvgetcommunicator: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector) -> *mut ::std::os::raw::c_void>,
    pub nvgetlength: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector) -> sunindextype>,
    pub nvlinearsum:
        ::std::option::Option<unsafe extern "C" fn(arg1: realtype, arg2: N_Vector, arg3: realtype, arg4: N_Vector, arg5: N_Vector)>,
    pub nvconst: ::std::option::Option<unsafe extern "C" fn(arg1: realtype, arg2: N_Vector)>,
    pub nvprod: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector, arg3: N_Vector)>,
    pub nvdiv: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector, arg3: N_Vector)>,
    pub nvscale: ::std::option::Option<unsafe extern "C" fn(arg1: realtype, arg2: N_Vector, arg3: N_Vector)>,
    pub nvabs: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector)>,
    pub nvinv: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector)>,
    pub nvaddconst: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: realtype, arg3: N_Vector)>,
    pub nvdotprod: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector) -> realtype>,
    pub nvmaxnorm: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector) -> realtype>,
    pub nvwrmsnorm: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector) -> realtype>,
    pub nvwrmsnormmask: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector, arg3: N_Vector) -> realtype>,
    pub nvmin: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector) -> realtype>,
    pub nvwl2norm: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector) -> realtype>,
    pub nvl1norm: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector) -> realtype>,
    pub nvcompare: ::std::option::Option<unsafe extern "C" fn(arg1: realtype, arg2: N_Vector, arg3: N_Vector)>,
    pub nvinvtest: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector) -> ::std::os::raw::c_int>,
    pub nvconstrmask: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector, arg3: N_Vector) -> ::std::os::raw::c_int>,
    pub nvminquotient: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector) -> realtype>,
    pub nvlinearcombination: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: ::std::os::raw::c_int,
            arg2: *mut realtype,
            arg3: *mut N_Vector,
            arg4: N_Vector,
        ) -> ::std::os::raw::c_int,
    >,
    pub nvscaleaddmulti: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: ::std::os::raw::c_int,
            arg2: *mut realtype,
            arg3: N_Vector,
            arg4: *mut N_Vector,
            arg5: *mut N_Vector,
        ) -> ::std::os::raw::c_int,
    >,
    pub nvdotprodmulti: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: ::std::os::raw::c_int,
            arg2: N_Vector,
            arg3: *mut N_Vector,
            arg4: *mut realtype,
        ) -> ::std::os::raw::c_int,
    >,
    pub nvlinearsumvectorarray: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: ::std::os::raw::c_int,
            arg2: realtype,
            arg3: *mut N_Vector,
            arg4: realtype,
            arg5: *mut N_Vector,
            arg6: *mut N_Vector,
        ) -> ::std::os::raw::c_int,
    >,
    pub nvscalevectorarray: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: ::std::os::raw::c_int,
            arg2: *mut realtype,
            arg3: *mut N_Vector,
            arg4: *mut N_Vector,
        ) -> ::std::os::raw::c_int,
    >,
    pub nvconstvectorarray: ::std::option::Option<
        unsafe extern "C" fn(arg1: ::std::os::raw::c_int, arg2: realtype, arg3: *mut N_Vector) -> ::std::os::raw::c_int,
    >,
    pub nvwrmsnormvectorarray: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: ::std::os::raw::c_int,
            arg2: *mut N_Vector,
            arg3: *mut N_Vector,
            arg4: *mut realtype,
        ) -> ::std::os::raw::c_int,
    >,
    pub nvwrmsnormmaskvectorarray: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: ::std::os::raw::c_int,
            arg2: *mut N_Vector,
            arg3: *mut N_Vector,
            arg4: N_Vector,
            arg5: *mut realtype,
        ) -> ::std::os::raw::c_int,
    >,
    pub nvscaleaddmultivectorarray: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: ::std::os::raw::c_int,
            arg2: ::std::os::raw::c_int,
            arg3: *mut realtype,
            arg4: *mut N_Vector,
            arg5: *mut *mut N_Vector,
            arg6: *mut *mut N_Vector,
        ) -> ::std::os::raw::c_int,
    >,
    pub nvlinearcombinationvectorarray: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: ::std::os::raw::c_int,
            arg2: ::std::os::raw::c_int,
            arg3: *mut realtype,
            arg4: *mut *mut N_Vector,
            arg5: *mut N_Vector,
        ) -> ::std::os::raw::c_int,
    >,
    pub nvdotprodlocal: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector) -> realtype>,
    pub nvmaxnormlocal: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector) -> realtype>,
    pub nvminlocal: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector) -> realtype>,
    pub nvl1normlocal: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector) -> realtype>,
    pub nvinvtestlocal: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector) -> ::std::os::raw::c_int>,
    pub nvconstrmasklocal:
        ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector, arg3: N_Vector) -> ::std::os::raw::c_int>,
    pub nvminquotientlocal: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector) -> realtype>,
    pub nvwsqrsumlocal: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector) -> realtype>,
    pub nvwsqrsummasklocal: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: N_Vector, arg3: N_Vector) -> realtype>,
    pub nvdotprodmultilocal: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: ::std::os::raw::c_int,
            arg2: N_Vector,
            arg3: *mut N_Vector,
            arg4: *mut realtype,
        ) -> ::std::os::raw::c_int,
    >,
    pub nvdotprodmultiallreduce: ::std::option::Option<
        unsafe extern "C" fn(arg1: ::std::os::raw::c_int, arg2: N_Vector, arg3: *mut realtype) -> ::std::os::raw::c_int,
    >,
    pub nvbufsize: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: *mut sunindextype) -> ::std::os::raw::c_int>,
    pub nvbufpack: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: *mut ::std::os::raw::c_void) -> ::std::os::raw::c_int>,
    pub nvbufunpack:
        ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: *mut ::std::os::raw::c_void) -> ::std::os::raw::c_int>,
    pub nvprint: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector)>,
    pub nvprintfile: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector, arg2: *mut FILE)>,
    pub nvgetlocallength: ::std::option::Option<unsafe extern "C" fn(arg1: N_Vector) -> sunindextype>,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of _generic_N_Vector_Ops"][::std::mem::size_of::<_generic_N_Vector_Ops>() - 448usize];
    ["Alignment of _generic_N_Vector_Ops"][::std::mem::align_of::<_generic_N_Vector_Ops>() - 8usize];
    ["Offset of field: _generic_N_Vector_Ops::nvgetvectorid"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvgetvectorid) - 0usize];
    ["Offset of field: _generic_N_Vector_Ops::nvclone"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvclone) - 8usize];
    ["Offset of field: _generic_N_Vector_Ops::nvcloneempty"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvcloneempty) - 16usize];
    ["Offset of field: _generic_N_Vector_Ops::nvdestroy"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvdestroy) - 24usize];
    ["Offset of field: _generic_N_Vector_Ops::nvspace"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvspace) - 32usize];
    ["Offset of field: _generic_N_Vector_Ops::nvgetarraypointer"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvgetarraypointer) - 40usize];
    ["Offset of field: _generic_N_Vector_Ops::nvgetdevicearraypointer"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvgetdevicearraypointer) - 48usize];
    ["Offset of field: _generic_N_Vector_Ops::nvsetarraypointer"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvsetarraypointer) - 56usize];
    ["Offset of field: _generic_N_Vector_Ops::nvgetcommunicator"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvgetcommunicator) - 64usize];
    ["Offset of field: _generic_N_Vector_Ops::nvgetlength"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvgetlength) - 72usize];
    ["Offset of field: _generic_N_Vector_Ops::nvlinearsum"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvlinearsum) - 80usize];
    ["Offset of field: _generic_N_Vector_Ops::nvconst"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvconst) - 88usize];
    ["Offset of field: _generic_N_Vector_Ops::nvprod"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvprod) - 96usize];
    ["Offset of field: _generic_N_Vector_Ops::nvdiv"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvdiv) - 104usize];
    ["Offset of field: _generic_N_Vector_Ops::nvscale"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvscale) - 112usize];
    ["Offset of field: _generic_N_Vector_Ops::nvabs"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvabs) - 120usize];
    ["Offset of field: _generic_N_Vector_Ops::nvinv"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvinv) - 128usize];
    ["Offset of field: _generic_N_Vector_Ops::nvaddconst"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvaddconst) - 136usize];
    ["Offset of field: _generic_N_Vector_Ops::nvdotprod"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvdotprod) - 144usize];
    ["Offset of field: _generic_N_Vector_Ops::nvmaxnorm"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvmaxnorm) - 152usize];
    ["Offset of field: _generic_N_Vector_Ops::nvwrmsnorm"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvwrmsnorm) - 160usize];
    ["Offset of field: _generic_N_Vector_Ops::nvwrmsnormmask"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvwrmsnormmask) - 168usize];
    ["Offset of field: _generic_N_Vector_Ops::nvmin"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvmin) - 176usize];
    ["Offset of field: _generic_N_Vector_Ops::nvwl2norm"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvwl2norm) - 184usize];
    ["Offset of field: _generic_N_Vector_Ops::nvl1norm"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvl1norm) - 192usize];
    ["Offset of field: _generic_N_Vector_Ops::nvcompare"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvcompare) - 200usize];
    ["Offset of field: _generic_N_Vector_Ops::nvinvtest"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvinvtest) - 208usize];
    ["Offset of field: _generic_N_Vector_Ops::nvconstrmask"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvconstrmask) - 216usize];
    ["Offset of field: _generic_N_Vector_Ops::nvminquotient"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvminquotient) - 224usize];
    ["Offset of field: _generic_N_Vector_Ops::nvlinearcombination"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvlinearcombination) - 232usize];
    ["Offset of field: _generic_N_Vector_Ops::nvscaleaddmulti"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvscaleaddmulti) - 240usize];
    ["Offset of field: _generic_N_Vector_Ops::nvdotprodmulti"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvdotprodmulti) - 248usize];
    ["Offset of field: _generic_N_Vector_Ops::nvlinearsumvectorarray"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvlinearsumvectorarray) - 256usize];
    ["Offset of field: _generic_N_Vector_Ops::nvscalevectorarray"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvscalevectorarray) - 264usize];
    ["Offset of field: _generic_N_Vector_Ops::nvconstvectorarray"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvconstvectorarray) - 272usize];
    ["Offset of field: _generic_N_Vector_Ops::nvwrmsnormvectorarray"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvwrmsnormvectorarray) - 280usize];
    ["Offset of field: _generic_N_Vector_Ops::nvwrmsnormmaskvectorarray"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvwrmsnormmaskvectorarray) - 288usize];
    ["Offset of field: _generic_N_Vector_Ops::nvscaleaddmultivectorarray"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvscaleaddmultivectorarray) - 296usize];
    ["Offset of field: _generic_N_Vector_Ops::nvlinearcombinationvectorarray"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvlinearcombinationvectorarray) - 304usize];
    ["Offset of field: _generic_N_Vector_Ops::nvdotprodlocal"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvdotprodlocal) - 312usize];
    ["Offset of field: _generic_N_Vector_Ops::nvmaxnormlocal"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvmaxnormlocal) - 320usize];
    ["Offset of field: _generic_N_Vector_Ops::nvminlocal"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvminlocal) - 328usize];
    ["Offset of field: _generic_N_Vector_Ops::nvl1normlocal"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvl1normlocal) - 336usize];
    ["Offset of field: _generic_N_Vector_Ops::nvinvtestlocal"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvinvtestlocal) - 344usize];
    ["Offset of field: _generic_N_Vector_Ops::nvconstrmasklocal"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvconstrmasklocal) - 352usize];
    ["Offset of field: _generic_N_Vector_Ops::nvminquotientlocal"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvminquotientlocal) - 360usize];
    ["Offset of field: _generic_N_Vector_Ops::nvwsqrsumlocal"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvwsqrsumlocal) - 368usize];
    ["Offset of field: _generic_N_Vector_Ops::nvwsqrsummasklocal"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvwsqrsummasklocal) - 376usize];
    ["Offset of field: _generic_N_Vector_Ops::nvdotprodmultilocal"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvdotprodmultilocal) - 384usize];
    ["Offset of field: _generic_N_Vector_Ops::nvdotprodmultiallreduce"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvdotprodmultiallreduce) - 392usize];
    ["Offset of field: _generic_N_Vector_Ops::nvbufsize"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvbufsize) - 400usize];
    ["Offset of field: _generic_N_Vector_Ops::nvbufpack"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvbufpack) - 408usize];
    ["Offset of field: _generic_N_Vector_Ops::nvbufunpack"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvbufunpack) - 416usize];
    ["Offset of field: _generic_N_Vector_Ops::nvprint"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvprint) - 424usize];
    ["Offset of field: _generic_N_Vector_Ops::nvprintfile"][::std::mem::offset_of!(_generic_N_Vector_Ops, nvprintfile) - 432usize];
    ["Offset of field: _generic_N_Vector_Ops::nvgetlocallength"]
        [::std::mem::offset_of!(_generic_N_Vector_Ops, nvgetlocallength) - 440usize];
};
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _generic_N_Vector {
    pub content: *mut ::std::os::raw::c_void,
    pub ops: N_Vector_Ops,
    pub sunctx: SUNContext,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of _generic_N_Vector"][::std::mem::size_of::<_generic_N_Vector>() - 24usize];
    ["Alignment of _generic_N_Vector"][::std::mem::align_of::<_generic_N_Vector>() - 8usize];
    ["Offset of field: _generic_N_Vector::content"][::std::mem::offset_of!(_generic_N_Vector, content) - 0usize];
    ["Offset of field: _generic_N_Vector::ops"][::std::mem::offset_of!(_generic_N_Vector, ops) - 8usize];
    ["Offset of field: _generic_N_Vector::sunctx"][::std::mem::offset_of!(_generic_N_Vector, sunctx) - 16usize];
};
unsafe extern "C" {
    pub fn N_VDestroy(v: N_Vector);
}
unsafe extern "C" {
    pub fn N_VLinearSum(a: realtype, x: N_Vector, b: realtype, y: N_Vector, z: N_Vector);
}
unsafe extern "C" {
    pub fn N_VConst(c: realtype, z: N_Vector);
}
unsafe extern "C" {
    pub fn N_VProd(x: N_Vector, y: N_Vector, z: N_Vector);
}
unsafe extern "C" {
    pub fn N_VDiv(x: N_Vector, y: N_Vector, z: N_Vector);
}
unsafe extern "C" {
    pub fn N_VScale(c: realtype, x: N_Vector, z: N_Vector);
}
unsafe extern "C" {
    pub fn N_VAbs(x: N_Vector, z: N_Vector);
}
unsafe extern "C" {
    pub fn N_VInv(x: N_Vector, z: N_Vector);
}
unsafe extern "C" {
    pub fn N_VAddConst(x: N_Vector, b: realtype, z: N_Vector);
}
unsafe extern "C" {
    pub fn N_VDotProd(x: N_Vector, y: N_Vector) -> realtype;
}
unsafe extern "C" {
    pub fn N_VMaxNorm(x: N_Vector) -> realtype;
}
unsafe extern "C" {
    pub fn N_VWrmsNorm(x: N_Vector, w: N_Vector) -> realtype;
}
unsafe extern "C" {
    pub fn N_VMin(x: N_Vector) -> realtype;
}
unsafe extern "C" {
    pub fn N_VWL2Norm(x: N_Vector, w: N_Vector) -> realtype;
}
unsafe extern "C" {
    pub fn N_VL1Norm(x: N_Vector) -> realtype;
}
unsafe extern "C" {
    pub fn N_VLinearCombination(nvec: ::std::os::raw::c_int, c: *mut realtype, X: *mut N_Vector, z: N_Vector) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn N_VLinearSumVectorArray(
        nvec: ::std::os::raw::c_int,
        a: realtype,
        X: *mut N_Vector,
        b: realtype,
        Y: *mut N_Vector,
        Z: *mut N_Vector,
    ) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn N_VScaleVectorArray(nvec: ::std::os::raw::c_int, c: *mut realtype, X: *mut N_Vector, Z: *mut N_Vector) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn N_VNew_Serial(vec_length: sunindextype, sunctx: SUNContext) -> N_Vector;
}
pub type SUNATimesFn =
    ::std::option::Option<unsafe extern "C" fn(A_data: *mut ::std::os::raw::c_void, v: N_Vector, z: N_Vector) -> ::std::os::raw::c_int>;
pub type SUNPSetupFn = ::std::option::Option<unsafe extern "C" fn(P_data: *mut ::std::os::raw::c_void) -> ::std::os::raw::c_int>;
pub type SUNPSolveFn = ::std::option::Option<
    unsafe extern "C" fn(
        P_data: *mut ::std::os::raw::c_void,
        r: N_Vector,
        z: N_Vector,
        tol: realtype,
        lr: ::std::os::raw::c_int,
    ) -> ::std::os::raw::c_int,
>;
pub const SUNMatrix_ID_SUNMATRIX_DENSE: SUNMatrix_ID = 0;
pub const SUNMatrix_ID_SUNMATRIX_MAGMADENSE: SUNMatrix_ID = 1;
pub const SUNMatrix_ID_SUNMATRIX_ONEMKLDENSE: SUNMatrix_ID = 2;
pub const SUNMatrix_ID_SUNMATRIX_BAND: SUNMatrix_ID = 3;
pub const SUNMatrix_ID_SUNMATRIX_SPARSE: SUNMatrix_ID = 4;
pub const SUNMatrix_ID_SUNMATRIX_SLUNRLOC: SUNMatrix_ID = 5;
pub const SUNMatrix_ID_SUNMATRIX_CUSPARSE: SUNMatrix_ID = 6;
pub const SUNMatrix_ID_SUNMATRIX_GINKGO: SUNMatrix_ID = 7;
pub const SUNMatrix_ID_SUNMATRIX_KOKKOSDENSE: SUNMatrix_ID = 8;
pub const SUNMatrix_ID_SUNMATRIX_CUSTOM: SUNMatrix_ID = 9;
pub type SUNMatrix_ID = ::std::os::raw::c_uint;
pub type SUNMatrix_Ops = *mut _generic_SUNMatrix_Ops;
pub type SUNMatrix = *mut _generic_SUNMatrix;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _generic_SUNMatrix_Ops {
    pub getid: ::std::option::Option<unsafe extern "C" fn(arg1: SUNMatrix) -> SUNMatrix_ID>,
    pub clone: ::std::option::Option<unsafe extern "C" fn(arg1: SUNMatrix) -> SUNMatrix>,
    pub destroy: ::std::option::Option<unsafe extern "C" fn(arg1: SUNMatrix)>,
    pub zero: ::std::option::Option<unsafe extern "C" fn(arg1: SUNMatrix) -> ::std::os::raw::c_int>,
    pub copy: ::std::option::Option<unsafe extern "C" fn(arg1: SUNMatrix, arg2: SUNMatrix) -> ::std::os::raw::c_int>,
    pub scaleadd: ::std::option::Option<unsafe extern "C" fn(arg1: realtype, arg2: SUNMatrix, arg3: SUNMatrix) -> ::std::os::raw::c_int>,
    pub scaleaddi: ::std::option::Option<unsafe extern "C" fn(arg1: realtype, arg2: SUNMatrix) -> ::std::os::raw::c_int>,
    pub matvecsetup: ::std::option::Option<unsafe extern "C" fn(arg1: SUNMatrix) -> ::std::os::raw::c_int>,
    pub matvec: ::std::option::Option<unsafe extern "C" fn(arg1: SUNMatrix, arg2: N_Vector, arg3: N_Vector) -> ::std::os::raw::c_int>,
    pub space: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: SUNMatrix,
            arg2: *mut ::std::os::raw::c_long,
            arg3: *mut ::std::os::raw::c_long,
        ) -> ::std::os::raw::c_int,
    >,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of _generic_SUNMatrix_Ops"][::std::mem::size_of::<_generic_SUNMatrix_Ops>() - 80usize];
    ["Alignment of _generic_SUNMatrix_Ops"][::std::mem::align_of::<_generic_SUNMatrix_Ops>() - 8usize];
    ["Offset of field: _generic_SUNMatrix_Ops::getid"][::std::mem::offset_of!(_generic_SUNMatrix_Ops, getid) - 0usize];
    ["Offset of field: _generic_SUNMatrix_Ops::clone"][::std::mem::offset_of!(_generic_SUNMatrix_Ops, clone) - 8usize];
    ["Offset of field: _generic_SUNMatrix_Ops::destroy"][::std::mem::offset_of!(_generic_SUNMatrix_Ops, destroy) - 16usize];
    ["Offset of field: _generic_SUNMatrix_Ops::zero"][::std::mem::offset_of!(_generic_SUNMatrix_Ops, zero) - 24usize];
    ["Offset of field: _generic_SUNMatrix_Ops::copy"][::std::mem::offset_of!(_generic_SUNMatrix_Ops, copy) - 32usize];
    ["Offset of field: _generic_SUNMatrix_Ops::scaleadd"][::std::mem::offset_of!(_generic_SUNMatrix_Ops, scaleadd) - 40usize];
    ["Offset of field: _generic_SUNMatrix_Ops::scaleaddi"][::std::mem::offset_of!(_generic_SUNMatrix_Ops, scaleaddi) - 48usize];
    ["Offset of field: _generic_SUNMatrix_Ops::matvecsetup"][::std::mem::offset_of!(_generic_SUNMatrix_Ops, matvecsetup) - 56usize];
    ["Offset of field: _generic_SUNMatrix_Ops::matvec"][::std::mem::offset_of!(_generic_SUNMatrix_Ops, matvec) - 64usize];
    ["Offset of field: _generic_SUNMatrix_Ops::space"][::std::mem::offset_of!(_generic_SUNMatrix_Ops, space) - 72usize];
};
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _generic_SUNMatrix {
    pub content: *mut ::std::os::raw::c_void,
    pub ops: SUNMatrix_Ops,
    pub sunctx: SUNContext,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of _generic_SUNMatrix"][::std::mem::size_of::<_generic_SUNMatrix>() - 24usize];
    ["Alignment of _generic_SUNMatrix"][::std::mem::align_of::<_generic_SUNMatrix>() - 8usize];
    ["Offset of field: _generic_SUNMatrix::content"][::std::mem::offset_of!(_generic_SUNMatrix, content) - 0usize];
    ["Offset of field: _generic_SUNMatrix::ops"][::std::mem::offset_of!(_generic_SUNMatrix, ops) - 8usize];
    ["Offset of field: _generic_SUNMatrix::sunctx"][::std::mem::offset_of!(_generic_SUNMatrix, sunctx) - 16usize];
};
pub const SUNLinearSolver_Type_SUNLINEARSOLVER_DIRECT: SUNLinearSolver_Type = 0;
pub const SUNLinearSolver_Type_SUNLINEARSOLVER_ITERATIVE: SUNLinearSolver_Type = 1;
pub const SUNLinearSolver_Type_SUNLINEARSOLVER_MATRIX_ITERATIVE: SUNLinearSolver_Type = 2;
pub const SUNLinearSolver_Type_SUNLINEARSOLVER_MATRIX_EMBEDDED: SUNLinearSolver_Type = 3;
pub type SUNLinearSolver_Type = ::std::os::raw::c_uint;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_BAND: SUNLinearSolver_ID = 0;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_DENSE: SUNLinearSolver_ID = 1;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_KLU: SUNLinearSolver_ID = 2;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_LAPACKBAND: SUNLinearSolver_ID = 3;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_LAPACKDENSE: SUNLinearSolver_ID = 4;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_PCG: SUNLinearSolver_ID = 5;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_SPBCGS: SUNLinearSolver_ID = 6;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_SPFGMR: SUNLinearSolver_ID = 7;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_SPGMR: SUNLinearSolver_ID = 8;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_SPTFQMR: SUNLinearSolver_ID = 9;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_SUPERLUDIST: SUNLinearSolver_ID = 10;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_SUPERLUMT: SUNLinearSolver_ID = 11;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_CUSOLVERSP_BATCHQR: SUNLinearSolver_ID = 12;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_MAGMADENSE: SUNLinearSolver_ID = 13;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_ONEMKLDENSE: SUNLinearSolver_ID = 14;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_GINKGO: SUNLinearSolver_ID = 15;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_KOKKOSDENSE: SUNLinearSolver_ID = 16;
pub const SUNLinearSolver_ID_SUNLINEARSOLVER_CUSTOM: SUNLinearSolver_ID = 17;
pub type SUNLinearSolver_ID = ::std::os::raw::c_uint;
pub type SUNLinearSolver_Ops = *mut _generic_SUNLinearSolver_Ops;
pub type SUNLinearSolver = *mut _generic_SUNLinearSolver;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _generic_SUNLinearSolver_Ops {
    pub gettype: ::std::option::Option<unsafe extern "C" fn(arg1: SUNLinearSolver) -> SUNLinearSolver_Type>,
    pub getid: ::std::option::Option<unsafe extern "C" fn(arg1: SUNLinearSolver) -> SUNLinearSolver_ID>,
    pub setatimes: ::std::option::Option<
        unsafe extern "C" fn(arg1: SUNLinearSolver, arg2: *mut ::std::os::raw::c_void, arg3: SUNATimesFn) -> ::std::os::raw::c_int,
    >,
    pub setpreconditioner: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: SUNLinearSolver,
            arg2: *mut ::std::os::raw::c_void,
            arg3: SUNPSetupFn,
            arg4: SUNPSolveFn,
        ) -> ::std::os::raw::c_int,
    >,
    pub setscalingvectors:
        ::std::option::Option<unsafe extern "C" fn(arg1: SUNLinearSolver, arg2: N_Vector, arg3: N_Vector) -> ::std::os::raw::c_int>,
    pub setzeroguess:
        ::std::option::Option<unsafe extern "C" fn(arg1: SUNLinearSolver, arg2: ::std::os::raw::c_int) -> ::std::os::raw::c_int>,
    pub initialize: ::std::option::Option<unsafe extern "C" fn(arg1: SUNLinearSolver) -> ::std::os::raw::c_int>,
    pub setup: ::std::option::Option<unsafe extern "C" fn(arg1: SUNLinearSolver, arg2: SUNMatrix) -> ::std::os::raw::c_int>,
    pub solve: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: SUNLinearSolver,
            arg2: SUNMatrix,
            arg3: N_Vector,
            arg4: N_Vector,
            arg5: realtype,
        ) -> ::std::os::raw::c_int,
    >,
    pub numiters: ::std::option::Option<unsafe extern "C" fn(arg1: SUNLinearSolver) -> ::std::os::raw::c_int>,
    pub resnorm: ::std::option::Option<unsafe extern "C" fn(arg1: SUNLinearSolver) -> realtype>,
    pub lastflag: ::std::option::Option<unsafe extern "C" fn(arg1: SUNLinearSolver) -> sunindextype>,
    pub space: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: SUNLinearSolver,
            arg2: *mut ::std::os::raw::c_long,
            arg3: *mut ::std::os::raw::c_long,
        ) -> ::std::os::raw::c_int,
    >,
    pub resid: ::std::option::Option<unsafe extern "C" fn(arg1: SUNLinearSolver) -> N_Vector>,
    pub free: ::std::option::Option<unsafe extern "C" fn(arg1: SUNLinearSolver) -> ::std::os::raw::c_int>,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of _generic_SUNLinearSolver_Ops"][::std::mem::size_of::<_generic_SUNLinearSolver_Ops>() - 120usize];
    ["Alignment of _generic_SUNLinearSolver_Ops"][::std::mem::align_of::<_generic_SUNLinearSolver_Ops>() - 8usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::gettype"][::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, gettype) - 0usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::getid"][::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, getid) - 8usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::setatimes"][::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, setatimes) - 16usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::setpreconditioner"]
        [::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, setpreconditioner) - 24usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::setscalingvectors"]
        [::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, setscalingvectors) - 32usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::setzeroguess"]
        [::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, setzeroguess) - 40usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::initialize"]
        [::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, initialize) - 48usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::setup"][::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, setup) - 56usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::solve"][::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, solve) - 64usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::numiters"][::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, numiters) - 72usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::resnorm"][::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, resnorm) - 80usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::lastflag"][::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, lastflag) - 88usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::space"][::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, space) - 96usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::resid"][::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, resid) - 104usize];
    ["Offset of field: _generic_SUNLinearSolver_Ops::free"][::std::mem::offset_of!(_generic_SUNLinearSolver_Ops, free) - 112usize];
};
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _generic_SUNLinearSolver {
    pub content: *mut ::std::os::raw::c_void,
    pub ops: SUNLinearSolver_Ops,
    pub sunctx: SUNContext,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of _generic_SUNLinearSolver"][::std::mem::size_of::<_generic_SUNLinearSolver>() - 24usize];
    ["Alignment of _generic_SUNLinearSolver"][::std::mem::align_of::<_generic_SUNLinearSolver>() - 8usize];
    ["Offset of field: _generic_SUNLinearSolver::content"][::std::mem::offset_of!(_generic_SUNLinearSolver, content) - 0usize];
    ["Offset of field: _generic_SUNLinearSolver::ops"][::std::mem::offset_of!(_generic_SUNLinearSolver, ops) - 8usize];
    ["Offset of field: _generic_SUNLinearSolver::sunctx"][::std::mem::offset_of!(_generic_SUNLinearSolver, sunctx) - 16usize];
};
pub type SUNNonlinearSolver_Ops = *mut _generic_SUNNonlinearSolver_Ops;
pub type SUNNonlinearSolver = *mut _generic_SUNNonlinearSolver;
pub type SUNNonlinSolSysFn =
    ::std::option::Option<unsafe extern "C" fn(y: N_Vector, F: N_Vector, mem: *mut ::std::os::raw::c_void) -> ::std::os::raw::c_int>;
pub type SUNNonlinSolLSetupFn = ::std::option::Option<
    unsafe extern "C" fn(
        jbad: ::std::os::raw::c_int,
        jcur: *mut ::std::os::raw::c_int,
        mem: *mut ::std::os::raw::c_void,
    ) -> ::std::os::raw::c_int,
>;
pub type SUNNonlinSolLSolveFn =
    ::std::option::Option<unsafe extern "C" fn(b: N_Vector, mem: *mut ::std::os::raw::c_void) -> ::std::os::raw::c_int>;
pub type SUNNonlinSolConvTestFn = ::std::option::Option<
    unsafe extern "C" fn(
        NLS: SUNNonlinearSolver,
        y: N_Vector,
        del: N_Vector,
        tol: realtype,
        ewt: N_Vector,
        mem: *mut ::std::os::raw::c_void,
    ) -> ::std::os::raw::c_int,
>;
pub const SUNNonlinearSolver_Type_SUNNONLINEARSOLVER_ROOTFIND: SUNNonlinearSolver_Type = 0;
pub const SUNNonlinearSolver_Type_SUNNONLINEARSOLVER_FIXEDPOINT: SUNNonlinearSolver_Type = 1;
pub type SUNNonlinearSolver_Type = ::std::os::raw::c_uint;
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _generic_SUNNonlinearSolver_Ops {
    pub gettype: ::std::option::Option<unsafe extern "C" fn(arg1: SUNNonlinearSolver) -> SUNNonlinearSolver_Type>,
    pub initialize: ::std::option::Option<unsafe extern "C" fn(arg1: SUNNonlinearSolver) -> ::std::os::raw::c_int>,
    pub setup: ::std::option::Option<
        unsafe extern "C" fn(arg1: SUNNonlinearSolver, arg2: N_Vector, arg3: *mut ::std::os::raw::c_void) -> ::std::os::raw::c_int,
    >,
    pub solve: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: SUNNonlinearSolver,
            arg2: N_Vector,
            arg3: N_Vector,
            arg4: N_Vector,
            arg5: realtype,
            arg6: ::std::os::raw::c_int,
            arg7: *mut ::std::os::raw::c_void,
        ) -> ::std::os::raw::c_int,
    >,
    pub free: ::std::option::Option<unsafe extern "C" fn(arg1: SUNNonlinearSolver) -> ::std::os::raw::c_int>,
    pub setsysfn: ::std::option::Option<unsafe extern "C" fn(arg1: SUNNonlinearSolver, arg2: SUNNonlinSolSysFn) -> ::std::os::raw::c_int>,
    pub setlsetupfn:
        ::std::option::Option<unsafe extern "C" fn(arg1: SUNNonlinearSolver, arg2: SUNNonlinSolLSetupFn) -> ::std::os::raw::c_int>,
    pub setlsolvefn:
        ::std::option::Option<unsafe extern "C" fn(arg1: SUNNonlinearSolver, arg2: SUNNonlinSolLSolveFn) -> ::std::os::raw::c_int>,
    pub setctestfn: ::std::option::Option<
        unsafe extern "C" fn(
            arg1: SUNNonlinearSolver,
            arg2: SUNNonlinSolConvTestFn,
            arg3: *mut ::std::os::raw::c_void,
        ) -> ::std::os::raw::c_int,
    >,
    pub setmaxiters:
        ::std::option::Option<unsafe extern "C" fn(arg1: SUNNonlinearSolver, arg2: ::std::os::raw::c_int) -> ::std::os::raw::c_int>,
    pub getnumiters:
        ::std::option::Option<unsafe extern "C" fn(arg1: SUNNonlinearSolver, arg2: *mut ::std::os::raw::c_long) -> ::std::os::raw::c_int>,
    pub getcuriter:
        ::std::option::Option<unsafe extern "C" fn(arg1: SUNNonlinearSolver, arg2: *mut ::std::os::raw::c_int) -> ::std::os::raw::c_int>,
    pub getnumconvfails:
        ::std::option::Option<unsafe extern "C" fn(arg1: SUNNonlinearSolver, arg2: *mut ::std::os::raw::c_long) -> ::std::os::raw::c_int>,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of _generic_SUNNonlinearSolver_Ops"][::std::mem::size_of::<_generic_SUNNonlinearSolver_Ops>() - 104usize];
    ["Alignment of _generic_SUNNonlinearSolver_Ops"][::std::mem::align_of::<_generic_SUNNonlinearSolver_Ops>() - 8usize];
    ["Offset of field: _generic_SUNNonlinearSolver_Ops::gettype"]
        [::std::mem::offset_of!(_generic_SUNNonlinearSolver_Ops, gettype) - 0usize];
    ["Offset of field: _generic_SUNNonlinearSolver_Ops::initialize"]
        [::std::mem::offset_of!(_generic_SUNNonlinearSolver_Ops, initialize) - 8usize];
    ["Offset of field: _generic_SUNNonlinearSolver_Ops::setup"][::std::mem::offset_of!(_generic_SUNNonlinearSolver_Ops, setup) - 16usize];
    ["Offset of field: _generic_SUNNonlinearSolver_Ops::solve"][::std::mem::offset_of!(_generic_SUNNonlinearSolver_Ops, solve) - 24usize];
    ["Offset of field: _generic_SUNNonlinearSolver_Ops::free"][::std::mem::offset_of!(_generic_SUNNonlinearSolver_Ops, free) - 32usize];
    ["Offset of field: _generic_SUNNonlinearSolver_Ops::setsysfn"]
        [::std::mem::offset_of!(_generic_SUNNonlinearSolver_Ops, setsysfn) - 40usize];
    ["Offset of field: _generic_SUNNonlinearSolver_Ops::setlsetupfn"]
        [::std::mem::offset_of!(_generic_SUNNonlinearSolver_Ops, setlsetupfn) - 48usize];
    ["Offset of field: _generic_SUNNonlinearSolver_Ops::setlsolvefn"]
        [::std::mem::offset_of!(_generic_SUNNonlinearSolver_Ops, setlsolvefn) - 56usize];
    ["Offset of field: _generic_SUNNonlinearSolver_Ops::setctestfn"]
        [::std::mem::offset_of!(_generic_SUNNonlinearSolver_Ops, setctestfn) - 64usize];
    ["Offset of field: _generic_SUNNonlinearSolver_Ops::setmaxiters"]
        [::std::mem::offset_of!(_generic_SUNNonlinearSolver_Ops, setmaxiters) - 72usize];
    ["Offset of field: _generic_SUNNonlinearSolver_Ops::getnumiters"]
        [::std::mem::offset_of!(_generic_SUNNonlinearSolver_Ops, getnumiters) - 80usize];
    ["Offset of field: _generic_SUNNonlinearSolver_Ops::getcuriter"]
        [::std::mem::offset_of!(_generic_SUNNonlinearSolver_Ops, getcuriter) - 88usize];
    ["Offset of field: _generic_SUNNonlinearSolver_Ops::getnumconvfails"]
        [::std::mem::offset_of!(_generic_SUNNonlinearSolver_Ops, getnumconvfails) - 96usize];
};
#[repr(C)]
#[derive(Debug, Copy, Clone)]
pub struct _generic_SUNNonlinearSolver {
    pub content: *mut ::std::os::raw::c_void,
    pub ops: SUNNonlinearSolver_Ops,
    pub sunctx: SUNContext,
}
#[allow(clippy::unnecessary_operation, clippy::identity_op)]
const _: () = {
    ["Size of _generic_SUNNonlinearSolver"][::std::mem::size_of::<_generic_SUNNonlinearSolver>() - 24usize];
    ["Alignment of _generic_SUNNonlinearSolver"][::std::mem::align_of::<_generic_SUNNonlinearSolver>() - 8usize];
    ["Offset of field: _generic_SUNNonlinearSolver::content"][::std::mem::offset_of!(_generic_SUNNonlinearSolver, content) - 0usize];
    ["Offset of field: _generic_SUNNonlinearSolver::ops"][::std::mem::offset_of!(_generic_SUNNonlinearSolver, ops) - 8usize];
    ["Offset of field: _generic_SUNNonlinearSolver::sunctx"][::std::mem::offset_of!(_generic_SUNNonlinearSolver, sunctx) - 16usize];
};
pub type IDALsJacFn = ::std::option::Option<
    unsafe extern "C" fn(
        t: realtype,
        c_j: realtype,
        y: N_Vector,
        yp: N_Vector,
        r: N_Vector,
        Jac: SUNMatrix,
        user_data: *mut ::std::os::raw::c_void,
        tmp1: N_Vector,
        tmp2: N_Vector,
        tmp3: N_Vector,
    ) -> ::std::os::raw::c_int,
>;
unsafe extern "C" {
    pub fn IDASetLinearSolver(ida_mem: *mut ::std::os::raw::c_void, LS: SUNLinearSolver, A: SUNMatrix) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDASetJacFn(ida_mem: *mut ::std::os::raw::c_void, jac: IDALsJacFn) -> ::std::os::raw::c_int;
}
pub type IDAResFn = ::std::option::Option<
    unsafe extern "C" fn(
        tt: realtype,
        yy: N_Vector,
        yp: N_Vector,
        rr: N_Vector,
        user_data: *mut ::std::os::raw::c_void,
    ) -> ::std::os::raw::c_int,
>;
pub type IDAEwtFn = ::std::option::Option<
    unsafe extern "C" fn(y: N_Vector, ewt: N_Vector, user_data: *mut ::std::os::raw::c_void) -> ::std::os::raw::c_int,
>;
pub type IDAErrHandlerFn = ::std::option::Option<
    unsafe extern "C" fn(
        error_code: ::std::os::raw::c_int,
        module: *const ::std::os::raw::c_char,
        function: *const ::std::os::raw::c_char,
        msg: *mut ::std::os::raw::c_char,
        user_data: *mut ::std::os::raw::c_void,
    ),
>;
pub type IDAQuadRhsFn = ::std::option::Option<
    unsafe extern "C" fn(
        tres: realtype,
        yy: N_Vector,
        yp: N_Vector,
        rrQ: N_Vector,
        user_data: *mut ::std::os::raw::c_void,
    ) -> ::std::os::raw::c_int,
>;
unsafe extern "C" {
    pub fn IDACreate(sunctx: SUNContext) -> *mut ::std::os::raw::c_void;
}
unsafe extern "C" {
    pub fn IDAInit(
        ida_mem: *mut ::std::os::raw::c_void,
        res: IDAResFn,
        t0: realtype,
        yy0: N_Vector,
        yp0: N_Vector,
    ) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAReInit(ida_mem: *mut ::std::os::raw::c_void, t0: realtype, yy0: N_Vector, yp0: N_Vector) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAWFtolerances(ida_mem: *mut ::std::os::raw::c_void, efun: IDAEwtFn) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDACalcIC(ida_mem: *mut ::std::os::raw::c_void, icopt: ::std::os::raw::c_int, tout1: realtype) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDASetErrHandlerFn(
        ida_mem: *mut ::std::os::raw::c_void,
        ehfun: IDAErrHandlerFn,
        eh_data: *mut ::std::os::raw::c_void,
    ) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDASetUserData(ida_mem: *mut ::std::os::raw::c_void, user_data: *mut ::std::os::raw::c_void) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDASetMaxOrd(ida_mem: *mut ::std::os::raw::c_void, maxord: ::std::os::raw::c_int) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDASetMaxNumSteps(ida_mem: *mut ::std::os::raw::c_void, mxsteps: ::std::os::raw::c_long) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDASetInitStep(ida_mem: *mut ::std::os::raw::c_void, hin: realtype) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDASetMaxStep(ida_mem: *mut ::std::os::raw::c_void, hmax: realtype) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDASetMinStep(ida_mem: *mut ::std::os::raw::c_void, hmin: realtype) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDASetStopTime(ida_mem: *mut ::std::os::raw::c_void, tstop: realtype) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDASetSuppressAlg(ida_mem: *mut ::std::os::raw::c_void, suppressalg: ::std::os::raw::c_int) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDASetId(ida_mem: *mut ::std::os::raw::c_void, id: N_Vector) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDASetNonlinearSolver(ida_mem: *mut ::std::os::raw::c_void, NLS: SUNNonlinearSolver) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDASolve(
        ida_mem: *mut ::std::os::raw::c_void,
        tout: realtype,
        tret: *mut realtype,
        yret: N_Vector,
        ypret: N_Vector,
        itask: ::std::os::raw::c_int,
    ) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAGetDky(ida_mem: *mut ::std::os::raw::c_void, t: realtype, k: ::std::os::raw::c_int, dky: N_Vector) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAGetConsistentIC(ida_mem: *mut ::std::os::raw::c_void, yy0_mod: N_Vector, yp0_mod: N_Vector) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAGetLastOrder(ida_mem: *mut ::std::os::raw::c_void, klast: *mut ::std::os::raw::c_int) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAGetLastStep(ida_mem: *mut ::std::os::raw::c_void, hlast: *mut realtype) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAGetCurrentTime(ida_mem: *mut ::std::os::raw::c_void, tcur: *mut realtype) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAGetErrWeights(ida_mem: *mut ::std::os::raw::c_void, eweight: N_Vector) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAGetEstLocalErrors(ida_mem: *mut ::std::os::raw::c_void, ele: N_Vector) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAGetIntegratorStats(
        ida_mem: *mut ::std::os::raw::c_void,
        nsteps: *mut ::std::os::raw::c_long,
        nrevals: *mut ::std::os::raw::c_long,
        nlinsetups: *mut ::std::os::raw::c_long,
        netfails: *mut ::std::os::raw::c_long,
        qlast: *mut ::std::os::raw::c_int,
        qcur: *mut ::std::os::raw::c_int,
        hinused: *mut realtype,
        hlast: *mut realtype,
        hcur: *mut realtype,
        tcur: *mut realtype,
    ) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAGetNonlinearSystemData(
        ida_mem: *mut ::std::os::raw::c_void,
        tcur: *mut realtype,
        yypred: *mut N_Vector,
        yppred: *mut N_Vector,
        yyn: *mut N_Vector,
        ypn: *mut N_Vector,
        res: *mut N_Vector,
        cj: *mut realtype,
        user_data: *mut *mut ::std::os::raw::c_void,
    ) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAGetNumNonlinSolvConvFails(
        ida_mem: *mut ::std::os::raw::c_void,
        nnfails: *mut ::std::os::raw::c_long,
    ) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAFree(ida_mem: *mut *mut ::std::os::raw::c_void);
}
unsafe extern "C" {
    pub fn IDAQuadInit(ida_mem: *mut ::std::os::raw::c_void, rhsQ: IDAQuadRhsFn, yQ0: N_Vector) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAQuadReInit(ida_mem: *mut ::std::os::raw::c_void, yQ0: N_Vector) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAQuadSVtolerances(ida_mem: *mut ::std::os::raw::c_void, reltolQ: realtype, abstolQ: N_Vector) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDASetQuadErrCon(ida_mem: *mut ::std::os::raw::c_void, errconQ: ::std::os::raw::c_int) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAGetQuad(ida_mem: *mut ::std::os::raw::c_void, t: *mut realtype, yQout: N_Vector) -> ::std::os::raw::c_int;
}
unsafe extern "C" {
    pub fn IDAGetQuadDky(
        ida_mem: *mut ::std::os::raw::c_void,
        t: realtype,
        k: ::std::os::raw::c_int,
        dky: N_Vector,
    ) -> ::std::os::raw::c_int;
}
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
unsafe extern "C" {
    pub fn klu_l_defaults(Common: *mut klu_l_common) -> ::std::os::raw::c_long;
}
unsafe extern "C" {
    pub fn klu_l_analyze(
        arg1: ::std::os::raw::c_long,
        arg2: *mut ::std::os::raw::c_long,
        arg3: *mut ::std::os::raw::c_long,
        Common: *mut klu_l_common,
    ) -> *mut klu_l_symbolic;
}
unsafe extern "C" {
    pub fn klu_l_factor(
        arg1: *mut ::std::os::raw::c_long,
        arg2: *mut ::std::os::raw::c_long,
        arg3: *mut f64,
        arg4: *mut klu_l_symbolic,
        arg5: *mut klu_l_common,
    ) -> *mut klu_l_numeric;
}
unsafe extern "C" {
    pub fn klu_l_solve(
        arg1: *mut klu_l_symbolic,
        arg2: *mut klu_l_numeric,
        arg3: ::std::os::raw::c_long,
        arg4: ::std::os::raw::c_long,
        arg5: *mut f64,
        arg6: *mut klu_l_common,
    ) -> ::std::os::raw::c_long;
}
unsafe extern "C" {
    pub fn klu_l_refactor(
        arg1: *mut ::std::os::raw::c_long,
        arg2: *mut ::std::os::raw::c_long,
        arg3: *mut f64,
        arg4: *mut klu_l_symbolic,
        arg5: *mut klu_l_numeric,
        arg6: *mut klu_l_common,
    ) -> ::std::os::raw::c_long;
}
unsafe extern "C" {
    pub fn klu_l_free_symbolic(arg1: *mut *mut klu_l_symbolic, arg2: *mut klu_l_common) -> ::std::os::raw::c_long;
}
unsafe extern "C" {
    pub fn klu_l_free_numeric(arg1: *mut *mut klu_l_numeric, arg2: *mut klu_l_common) -> ::std::os::raw::c_long;
}
unsafe extern "C" {
    pub fn klu_l_condest(
        arg1: *mut ::std::os::raw::c_long,
        arg2: *mut f64,
        arg3: *mut klu_l_symbolic,
        arg4: *mut klu_l_numeric,
        arg5: *mut klu_l_common,
    ) -> ::std::os::raw::c_long;
}
unsafe extern "C" {
    pub fn klu_l_rcond(arg1: *mut klu_l_symbolic, arg2: *mut klu_l_numeric, arg3: *mut klu_l_common) -> ::std::os::raw::c_long;
}
