//! The border between C and the crate: pointers in, error codes and texts out, panics kept in.

use std::{
    cell::RefCell,
    error::Error,
    ffi::{CStr, CString, c_char, c_int},
    panic::{AssertUnwindSafe, catch_unwind},
    path::PathBuf,
};

/// What the crate or a check here says.
pub(super) type Fallible<T> = Result<T, Box<dyn Error>>;

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// What `work` returns, or `failed`, with the reason kept for `palpate_last_error`.
pub(super) fn guarded<T>(failed: T, work: impl FnOnce() -> Fallible<T>) -> T {
    let reason = match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(value)) => return value,
        Ok(Err(error)) => error.to_string(),
        Err(_) => "the library panicked; this is a fault of it".to_owned(),
    };
    let reason = CString::new(reason.replace('\0', " ")).unwrap_or_default();
    // A thread that is ending may have lost its text already; nobody will read it.
    let _ = LAST_ERROR.try_with(|last| *last.borrow_mut() = reason);
    failed
}

/// Why the last call of this thread that failed did so; empty before the first.
pub(super) fn last_error() -> *const c_char {
    LAST_ERROR.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// 0, or -1 where `work` fails.
pub(super) fn status(work: impl FnOnce() -> Fallible<()>) -> c_int {
    guarded(-1, || work().map(|()| 0))
}

/// The text at `pointer`, or `default` for NULL.
///
/// # Safety
/// `pointer` is NULL or points to text that ends with 0 and lasts as long as what is returned.
pub(super) unsafe fn text(pointer: *const c_char, default: &str) -> Fallible<&str> {
    if pointer.is_null() {
        return Ok(default);
    }
    // SAFETY: not NULL, and text by the caller's word.
    Ok(unsafe { CStr::from_ptr(pointer) }.to_str()?)
}

/// The text at `pointer` as the place of a folder, none where it is NULL. Errors: not UTF-8.
///
/// # Safety
/// `pointer` is NULL or text.
pub(super) unsafe fn folder(pointer: *const c_char) -> Fallible<Option<PathBuf>> {
    // SAFETY: NULL or text by the caller's word.
    let folder = unsafe { text(pointer, "") }?;
    Ok((!folder.is_empty()).then(|| folder.into()))
}

/// What `pointer` points to. Errors: NULL, by `name`.
///
/// # Safety
/// `pointer` is NULL or valid for reads while `'a` lasts.
pub(super) unsafe fn read<'a, T>(pointer: *const T, name: &str) -> Fallible<&'a T> {
    // SAFETY: valid by the caller's word; NULL becomes None.
    unsafe { pointer.as_ref() }.ok_or_else(|| format!("{name} is NULL").into())
}

/// What `pointer` points to, for writing. Errors: NULL, by `name`.
///
/// # Safety
/// `pointer` is NULL or valid for reads and writes, and nobody else uses it while `'a` lasts.
pub(super) unsafe fn write<'a, T>(pointer: *mut T, name: &str) -> Fallible<&'a mut T> {
    // SAFETY: valid and not shared by the caller's word; NULL becomes None.
    unsafe { pointer.as_mut() }.ok_or_else(|| format!("{name} is NULL").into())
}
