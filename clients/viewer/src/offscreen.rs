//! OpenGL without a window or a display: EGL, found at run time, on the graphics card or in Mesa's software renderer.

use glutin::api::egl::context::PossiblyCurrentContext;
use glutin::api::egl::device::Device;
use glutin::api::egl::display::Display;
use glutin::config::{ConfigSurfaceTypes, ConfigTemplateBuilder};
use glutin::context::{ContextApi, ContextAttributesBuilder, Version};
use glutin::display::GlDisplay;
use std::sync::Arc;
use three_d::Context;

/// Why there is no OpenGL.
#[derive(Debug, thiserror::Error)]
pub enum GraphicsError {
    /// No library, or none that works.
    #[error(
        "no OpenGL without a display: {0}; on Debian and Ubuntu `apt-get install libegl1 libgl1-mesa-dri` brings one that \
         needs no graphics card"
    )]
    None(String),
    /// OpenGL refused something.
    #[error("OpenGL: {0}")]
    OpenGl(String),
}

/// A context that is current on this thread until this is dropped.
pub struct Offscreen {
    /// To draw with.
    pub context: Context,
    // Last: OpenGL's objects go before it.
    _current: PossiblyCurrentContext,
}

impl Offscreen {
    /// A context on the first device that gives one.
    ///
    /// # Errors
    /// [`GraphicsError::None`] with what every device said.
    pub fn new() -> Result<Self, GraphicsError> {
        let devices = Device::query_devices().map_err(|e| GraphicsError::None(e.to_string()))?;
        let mut said = vec!["EGL knows no device".to_owned()];
        for device in devices {
            match Self::on(&device) {
                Ok(context) => return Ok(context),
                Err(e) => said.push(e),
            }
        }
        Err(GraphicsError::None(said.pop().unwrap_or_default()))
    }

    fn on(device: &Device) -> Result<Self, String> {
        fn said(e: impl std::fmt::Display) -> String {
            e.to_string()
        }
        // SAFETY: without a native display handle there is none that could be invalid.
        let display = unsafe { Display::with_device(device, None) }.map_err(said)?;
        let template = ConfigTemplateBuilder::new().with_surface_type(ConfigSurfaceTypes::empty()).build();
        // SAFETY: the template names no native window.
        let config = unsafe { display.find_configs(template) }.map_err(said)?.next().ok_or("no configuration")?;
        let attributes =
            ContextAttributesBuilder::new().with_context_api(ContextApi::OpenGl(Some(Version::new(3, 3)))).build(None);
        // SAFETY: the attributes name no native window.
        let context = unsafe { display.create_context(&config, &attributes) }.map_err(said)?;
        let current = context.make_current_surfaceless().map_err(said)?;
        let address = |name: &std::ffi::CStr| display.get_proc_address(name).cast();
        // SAFETY: the addresses are those of the context that has just been made current on this thread.
        let gl = unsafe { three_d::context::Context::from_loader_function_cstr(address) };
        let context = Context::from_gl_context(Arc::new(gl)).map_err(said)?;
        Ok(Self { context, _current: current })
    }
}
