//! A window in which the picture gets better while one looks, and the mesh can be turned.

use crate::{Args, cost::Cost, gpu, gpu::Gpu, tracer::Tracer, write_png};
use anyhow::{Context as _, Result};
use raykd::{BuildOptions, Mesh, Scene, rays::Camera};
use std::{sync::Arc, time::Instant};
use winit::{
    application::ApplicationHandler,
    dpi::PhysicalSize,
    event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent},
    event_loop::{ActiveEventLoop, EventLoop},
    keyboard::{KeyCode, PhysicalKey},
    window::{Window, WindowId},
};

/// What is asked of the picture if `--spp` is left out.
const ENOUGH: u32 = 1 << 16;

/// A camera that turns around what it looks at.
#[derive(Debug)]
struct Orbit {
    target: [f64; 3],
    distance: f64,
    /// Around the axis up, and above the horizon, in radians.
    yaw: f64,
    pitch: f64,
}

impl Orbit {
    fn of(camera: &Camera) -> Self {
        let [x, y, z] = [0, 1, 2].map(|a| camera.eye[a] - camera.target[a]);
        let distance = (x * x + y * y + z * z).sqrt();
        Self { target: camera.target, distance, yaw: x.atan2(z), pitch: (y / distance).asin() }
    }

    fn camera(&self, like: &Camera) -> Camera {
        let flat = self.distance * self.pitch.cos();
        let from = [flat * self.yaw.sin(), self.distance * self.pitch.sin(), flat * self.yaw.cos()];
        let eye = [0, 1, 2].map(|a| self.target[a] + from[a]);
        Camera { eye, target: self.target, ..like.clone() }
    }
}

/// What there is while the window is open.
#[derive(Debug)]
struct View {
    window: Arc<Window>,
    surface: wgpu::Surface<'static>,
    configuration: wgpu::SurfaceConfiguration,
    gpu: Gpu,
    scene: Scene,
    tracer: Tracer,
    /// If costs are shown.
    cost: Option<Cost>,
    pipeline: wgpu::RenderPipeline,
    since: Instant,
}

/// The program: what it was asked, and its window once that is open.
#[derive(Debug)]
struct App {
    args: Args,
    mesh: Mesh,
    camera: Camera,
    orbit: Orbit,
    cursor: [f64; 2],
    dragging: bool,
    view: Option<View>,
    failure: Option<anyhow::Error>,
}

pub(crate) fn run(args: Args) -> Result<()> {
    let mesh = args.mesh()?;
    let camera = args.camera(&mesh);
    let orbit = Orbit::of(&camera);
    let events = EventLoop::new()
        .context("no window can be opened here; make a picture with --headless -o FILE.png")?;
    let mut app =
        App { args, mesh, camera, orbit, cursor: [0.0; 2], dragging: false, view: None, failure: None };
    events.run_app(&mut app)?;
    app.failure.map_or(Ok(()), Err)
}

impl View {
    fn open(events: &ActiveEventLoop, args: &Args, mesh: &Mesh) -> Result<Self> {
        let size = PhysicalSize::new(args.size[0], args.size[1]);
        let attributes = Window::default_attributes().with_title("raykd").with_inner_size(size);
        let window = Arc::new(events.create_window(attributes)?);
        let instance = gpu::instance(Some(Box::new(events.owned_display_handle())));
        let surface = instance.create_surface(Arc::clone(&window))?;
        let adapter = gpu::adapter(&instance, args.device.as_deref(), Some(&surface))?;
        let gpu = Gpu::open(&adapter)?;
        let size = window.inner_size();
        let mut configuration = surface
            .get_default_config(&adapter, size.width.max(1), size.height.max(1))
            .context("the device cannot draw in this window")?;
        // Pixels have their curve already.
        let formats = surface.get_capabilities(&adapter).formats;
        let plain = formats.into_iter().find(|format| !format.is_srgb());
        configuration.format = plain.context("the window has no format of plain bytes")?;
        surface.configure(&gpu.device, &configuration);
        let scene = Scene::build(&gpu.raykd, mesh, &BuildOptions::default())?;
        let pipeline = pipeline(&gpu, configuration.format);
        let tracer = Self::tracer(&gpu, &scene, args, mesh, &configuration)?;
        let since = Instant::now();
        let mut view =
            Self { window, surface, configuration, gpu, scene, tracer, cost: None, pipeline, since };
        view.show_cost(args.cost)?;
        Ok(view)
    }

    /// One sample at a time, so that the window answers soon.
    fn tracer(
        gpu: &Gpu,
        scene: &Scene,
        args: &Args,
        mesh: &Mesh,
        configuration: &wgpu::SurfaceConfiguration,
    ) -> Result<Tracer> {
        let size = [configuration.width, configuration.height];
        Tracer::new(gpu, scene, mesh.bounds(), size, 1, args.bounces)
    }

    const fn size(&self) -> [u32; 2] {
        [self.configuration.width, self.configuration.height]
    }

    fn show_cost(&mut self, whether: bool) -> Result<()> {
        let cost = || Cost::new(&self.gpu, &self.scene, &self.tracer, self.size());
        self.cost = whether.then(cost).transpose()?;
        self.window.request_redraw();
        Ok(())
    }

    /// The pixels that are shown.
    fn pixels(&self) -> &wgpu::Buffer {
        self.cost.as_ref().map_or(&self.tracer.pixels, |cost| &cost.pixels)
    }

    fn look(&mut self, camera: &Camera) {
        self.tracer.look(&self.gpu, camera);
        self.since = Instant::now();
        self.window.request_redraw();
    }

    /// Traces one more sample a pixel and shows the picture.
    fn draw(&mut self, enough: u32) -> Result<()> {
        use wgpu::CurrentSurfaceTexture as Texture;
        let more = self.tracer.done() < enough;
        if more {
            let wave = self.tracer.wave(&self.gpu, 1)?;
            let waited = wgpu::PollType::Wait { submission_index: Some(wave.submission), timeout: None };
            self.gpu.device.poll(waited)?;
            let (samples, seconds) = (self.tracer.done(), self.since.elapsed().as_secs_f64());
            let speed = self.tracer.traced(&self.gpu)? as f64 / seconds / 1e6;
            self.window.set_title(&format!("raykd: {samples} paths a pixel, {speed:.1} Mray/s"));
        }
        if let Some(cost) = &self.cost {
            cost.draw(&self.gpu);
        }
        match self.surface.get_current_texture() {
            Texture::Success(texture) | Texture::Suboptimal(texture) => self.show(texture),
            Texture::Outdated | Texture::Lost => {
                self.surface.configure(&self.gpu.device, &self.configuration)
            }
            Texture::Timeout | Texture::Occluded | Texture::Validation => {}
        }
        if more {
            self.window.request_redraw();
        }
        Ok(())
    }

    fn show(&self, texture: wgpu::SurfaceTexture) {
        let buffers = [(0, self.pixels()), (1, &self.tracer.uniform)];
        let group = self.gpu.bind(&self.pipeline.get_bind_group_layout(0), &buffers);
        let view = texture.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let mut encoder = self.gpu.encoder();
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations::default(),
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
        drop(pass);
        self.gpu.queue.submit([encoder.finish()]);
        self.window.pre_present_notify();
        self.gpu.queue.present(texture);
    }
}

/// What shows the picture.
fn pipeline(gpu: &Gpu, format: wgpu::TextureFormat) -> wgpu::RenderPipeline {
    let module = gpu.device.create_shader_module(wgpu::include_wgsl!("window.wgsl"));
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("window"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("corner"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("pixel"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(format.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

impl App {
    fn react(&mut self, events: &ActiveEventLoop, event: WindowEvent) -> Result<()> {
        let Some(view) = &mut self.view else { return Ok(()) };
        match event {
            WindowEvent::CloseRequested => events.exit(),
            WindowEvent::RedrawRequested => view.draw(self.args.spp.unwrap_or(ENOUGH))?,
            WindowEvent::Resized(size) if size.width > 0 && size.height > 0 => {
                let to = [size.width, size.height];
                if to != view.size() {
                    [view.configuration.width, view.configuration.height] = to;
                    view.surface.configure(&view.gpu.device, &view.configuration);
                    view.tracer =
                        View::tracer(&view.gpu, &view.scene, &self.args, &self.mesh, &view.configuration)?;
                    view.show_cost(view.cost.is_some())?;
                    view.look(&self.orbit.camera(&self.camera));
                }
            }
            WindowEvent::MouseInput { state, button: MouseButton::Left, .. } => {
                self.dragging = state == ElementState::Pressed;
            }
            WindowEvent::CursorMoved { position, .. } => {
                let [x, y] = std::mem::replace(&mut self.cursor, [position.x, position.y]);
                if self.dragging {
                    self.orbit.yaw -= (position.x - x) * 0.008;
                    self.orbit.pitch = (self.orbit.pitch + (position.y - y) * 0.008).clamp(-0.2, 1.5);
                    view.look(&self.orbit.camera(&self.camera));
                }
            }
            WindowEvent::MouseWheel { delta, .. } => {
                let lines = match delta {
                    MouseScrollDelta::LineDelta(_, lines) => f64::from(lines),
                    MouseScrollDelta::PixelDelta(pixels) => pixels.y / 40.0,
                };
                self.orbit.distance *= 0.9f64.powf(lines);
                view.look(&self.orbit.camera(&self.camera));
            }
            WindowEvent::KeyboardInput { event, .. } if event.state == ElementState::Pressed => {
                match event.physical_key {
                    PhysicalKey::Code(KeyCode::Escape) => events.exit(),
                    PhysicalKey::Code(KeyCode::KeyC) => view.show_cost(view.cost.is_none())?,
                    PhysicalKey::Code(KeyCode::KeyR) => {
                        self.orbit = Orbit::of(&self.camera);
                        view.look(&self.camera);
                    }
                    PhysicalKey::Code(KeyCode::KeyS) => {
                        let path = self.args.output.clone().unwrap_or_else(|| "pathtracer.png".into());
                        write_png(&path, &view.gpu.read(view.pixels())?, view.size())?;
                        eprintln!("wrote {}", path.display());
                    }
                    _ => {}
                }
            }
            _ => {}
        }
        Ok(())
    }
}

impl ApplicationHandler for App {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.view.is_some() {
            return;
        }
        match View::open(events, &self.args, &self.mesh) {
            Ok(mut view) => {
                view.look(&self.camera);
                self.view = Some(view);
            }
            Err(error) => {
                self.failure = Some(error);
                events.exit();
            }
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        if let Err(error) = self.react(events, event) {
            self.failure = Some(error);
            events.exit();
        }
    }
}
