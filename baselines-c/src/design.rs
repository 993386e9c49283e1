//! Controllers come and go: read from bytes, designed by keywords, written, asked about, given back.

use crate::border::{Status, array, array_mut, guarded, one, place, refuse, refused, text};
use rodgym_baselines::Error;
use rodgym_baselines::registry::{Target, make};
use rodgym_baselines::saved::{self, Saved};
use rodgym_core::catalog::{self, MakeOptions};
use rodgym_core::env::AutoresetMode;
use serde_json::{Map, Value};
use std::ffi::{CString, c_char};
use std::ptr;

/// A controller; `rodgym_controller` of the header, which does not say what is in it.
pub struct Handle {
    pub(crate) saved: Saved,
    name: CString,
    observation: Vec<CString>,
    action: Vec<CString>,
}

impl Handle {
    fn new(saved: Saved) -> Self {
        // (Our names hold no zero.)
        let text = |name: &String| CString::new(name.as_str()).unwrap_or_default();
        Handle {
            name: text(&saved.name),
            observation: saved.target.observation.names.iter().map(text).collect(),
            action: saved.target.action.names.iter().map(text).collect(),
            saved,
        }
    }
}

/// Writes a new controller's pointer, or null where there is none.
///
/// # Safety
/// As `place` of `controller`.
unsafe fn give(
    controller: *mut *mut Handle,
    work: impl FnOnce() -> Result<Saved, Status>,
) -> Status {
    guarded(|| {
        // SAFETY: our caller's promise.
        let controller = unsafe { place("controller", controller) }?;
        *controller = ptr::null_mut();
        *controller = Box::into_raw(Box::new(Handle::new(work()?)));
        Ok(())
    })
}

/// Reads a controller from bytes. See the header.
///
/// # Safety
/// `bytes` points to `size` bytes, `controller` to room for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_load(
    bytes: *const u8,
    size: usize,
    controller: *mut *mut Handle,
) -> Status {
    // SAFETY: our caller's promises.
    unsafe {
        give(controller, || {
            saved::decode(array("bytes", bytes, size, size)?).map_err(|error| refused(&error))
        })
    }
}

/// Reads a controller from a file. See the header.
///
/// # Safety
/// `path` is a text, `controller` points to room for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_load_file(
    path: *const c_char,
    controller: *mut *mut Handle,
) -> Status {
    // SAFETY: our caller's promises.
    unsafe {
        give(controller, || {
            let path = text("path", path)?;
            let bytes = std::fs::read(path)
                .map_err(|error| refuse(Status::File, format_args!("{path}: {error}")))?;
            saved::decode(&bytes).map_err(|error| refused(&error))
        })
    }
}

/// Designs a controller. See the header.
///
/// # Safety
/// `name`, `id` and `keywords` are texts (the last may be null), `controller` points to room for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_design(
    name: *const c_char,
    id: *const c_char,
    keywords: *const c_char,
    controller: *mut *mut Handle,
) -> Status {
    // SAFETY: our caller's promises.
    unsafe {
        give(controller, || {
            let (name, id) = (text("name", name)?, text("id", id)?);
            let keywords = if keywords.is_null() { "{}" } else { text("keywords", keywords)? };
            let kwargs: Map<String, Value> = serde_json::from_str(keywords).map_err(|error| {
                let sentence = format_args!("keywords are no JSON object: {error}");
                refuse(Status::Parameter, sentence)
            })?;
            designed(name, id, kwargs).map_err(|error| refused(&error))
        })
    }
}

fn designed(name: &str, id: &str, kwargs: Map<String, Value>) -> Result<Saved, Error> {
    let env = catalog::make(&MakeOptions {
        id: id.into(),
        num_envs: 1,
        kwargs,
        autoreset_mode: AutoresetMode::Disabled,
        max_episode_steps: None,
        num_threads: 1,
    })?;
    let target = Target::from(env.spec());
    Ok(Saved { law: make(name, &target)?, name: name.into(), target })
}

/// Writes a controller as bytes. See the header.
///
/// # Safety
/// `controller` is one of ours, `bytes` points to room for `capacity` bytes (or is null with a capacity of 0), `size` to room
/// for a number.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_save(
    controller: *const Handle,
    bytes: *mut u8,
    capacity: usize,
    size: *mut usize,
) -> Status {
    // SAFETY: our caller's promises.
    guarded(|| unsafe {
        let Saved { name, target, law } = &one("controller", controller)?.saved;
        let size = place("size", size)?;
        let data = saved::encode(name, target, &**law).map_err(|error| refused(&error))?;
        *size = data.len();
        if capacity == 0 {
            return Ok(());
        }
        if capacity < data.len() {
            let needed = data.len();
            let sentence = format_args!("bytes has room for {capacity}, but {needed} are needed");
            return Err(refuse(Status::Size, sentence));
        }
        array_mut("bytes", bytes, capacity, capacity)?[..data.len()].copy_from_slice(&data);
        Ok(())
    })
}

/// Gives a controller back. See the header.
///
/// # Safety
/// `controller` is one of ours that was not given back yet, or null; nobody uses it any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_free(controller: *mut Handle) {
    if !controller.is_null() {
        guarded(|| {
            // SAFETY: `give` made it of a box; nobody else has it.
            drop(unsafe { Box::from_raw(controller) });
            Ok(())
        });
    }
}

/// Its name, such as "lqg"; null of null. See the header.
///
/// # Safety
/// `controller` is one of ours, or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_name(controller: *const Handle) -> *const c_char {
    // SAFETY: our caller's promise.
    unsafe { controller.as_ref() }.map_or(ptr::null(), |handle| handle.name.as_ptr())
}

/// Numbers of an observation; 0 of null. See the header.
///
/// # Safety
/// `controller` is one of ours, or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_observation_size(controller: *const Handle) -> usize {
    // SAFETY: our caller's promise.
    unsafe { controller.as_ref() }.map_or(0, |handle| handle.saved.law.observation_size())
}

/// Numbers of an action; 0 of null. See the header.
///
/// # Safety
/// `controller` is one of ours, or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_action_size(controller: *const Handle) -> usize {
    // SAFETY: our caller's promise.
    unsafe { controller.as_ref() }.map_or(0, |handle| handle.saved.law.action_size())
}

/// Numbers of the state; 0 of null. See the header.
///
/// # Safety
/// `controller` is one of ours, or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_state_size(controller: *const Handle) -> usize {
    // SAFETY: our caller's promise.
    unsafe { controller.as_ref() }.map_or(0, |handle| handle.saved.law.state_size())
}

/// What a number of the observation is, with its unit; null beyond them. See the header.
///
/// # Safety
/// `controller` is one of ours, or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_observation_name(
    controller: *const Handle,
    index: usize,
) -> *const c_char {
    // SAFETY: our caller's promise.
    let handle = unsafe { controller.as_ref() };
    handle.and_then(|handle| handle.observation.get(index)).map_or(ptr::null(), |n| n.as_ptr())
}

/// What a number of the action is, with its unit; null beyond them. See the header.
///
/// # Safety
/// `controller` is one of ours, or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_action_name(
    controller: *const Handle,
    index: usize,
) -> *const c_char {
    // SAFETY: our caller's promise.
    let handle = unsafe { controller.as_ref() };
    handle.and_then(|handle| handle.action.get(index)).map_or(ptr::null(), |n| n.as_ptr())
}

/// The number that a keyword has in the design. See the header.
///
/// # Safety
/// `controller` is one of ours, `keyword` a text, `value` points to room for a number.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn rodgym_keyword(
    controller: *const Handle,
    keyword: *const c_char,
    value: *mut f64,
) -> Status {
    // SAFETY: our caller's promises.
    guarded(|| unsafe {
        let config = &one("controller", controller)?.saved.target.config;
        let keyword = text("keyword", keyword)?;
        let value = place("value", value)?;
        *value = config.get(keyword).and_then(Value::as_f64).ok_or_else(|| {
            let names = config.iter().filter(|(_, value)| value.is_number());
            let names: Vec<&str> = names.map(|(name, _)| name.as_str()).collect();
            let names = names.join(", ");
            let sentence = format_args!("keyword = \"{keyword}\" is not one of {names}");
            refuse(Status::Parameter, sentence)
        })?;
        Ok(())
    })
}
