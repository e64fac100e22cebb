// The platform in three dimensions, with three.js: axes of the body, principal axes, wheels, jets, sensors, a hinge, weight.
import * as THREE from "/assets/three.js";
import { h } from "/assets/parts.js";

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const COLOURS = ["--c0", "--c1", "--c2"];
const vector = (v) => new THREE.Vector3(...v);

export class Scene {
  constructor(place, platform) {
    this.place = place;
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    const canvas = this.renderer.domElement;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${platform.platform} in three dimensions: ${[...new Set(platform.arrows.map((arrow) => (arrow.kind === "wheel" || arrow.kind === "jet" ? `${arrow.kind} ${arrow.name}` : arrow.name)))].join(", ")}. Drag or arrow keys turn the view, plus and minus zoom.`);
    place.append(canvas);
    this.labels = [];
    this.world = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(38, 1, 0.01, 100);
    this.view = { azimuth: 0.7, elevation: 0.45, distance: 4.4 };
    this.build(platform);
    this.controls(canvas);
    this.observer = new ResizeObserver(() => this.draw());
    this.observer.observe(place);
    this.dark = matchMedia("(prefers-color-scheme: dark)");
    this.again = () => { this.world.clear(); this.labels.forEach((l) => l.element.remove()); this.labels = []; this.build(platform); this.draw(); };
    this.dark.addEventListener("change", this.again);
    this.draw();
  }

  end() {
    this.observer.disconnect();
    this.dark.removeEventListener("change", this.again);
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }

  label(text, at) {
    const element = h("span", { className: "label3d", "aria-hidden": "true" }, text);
    this.place.append(element);
    this.labels.push({ element, at });
  }

  // One label for what has several arrows.
  once(text, at) { if (!this.labels.some((label) => label.element.textContent === text)) this.label(text, at); }

  arrow(from, to, colour, width = 0.012) {
    const along = to.clone().sub(from);
    const length = along.length();
    if (!(length > 1e-9)) return;
    const material = new THREE.MeshLambertMaterial({ color: colour });
    const shaft = new THREE.Mesh(new THREE.CylinderGeometry(width, width, length * 0.86, 12), material);
    const tip = new THREE.Mesh(new THREE.ConeGeometry(width * 2.8, length * 0.14, 16), material);
    const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.clone().normalize());
    shaft.quaternion.copy(turn);
    tip.quaternion.copy(turn);
    shaft.position.copy(from).addScaledVector(along, 0.43);
    tip.position.copy(from).addScaledVector(along, 0.93);
    this.world.add(shaft, tip);
  }

  build(platform) {
    this.world.add(new THREE.AmbientLight(0xffffff, 1.6));
    const light = new THREE.DirectionalLight(0xffffff, 1.8);
    light.position.set(2, -3, 5);
    this.world.add(light);
    const ink = css("--text");
    ["x", "y", "z"].forEach((name, k) => {
      const tip = new THREE.Vector3().setComponent(k, 1.15);
      this.arrow(new THREE.Vector3(), tip, css(COLOURS[k]));
      this.label(name, tip.clone().multiplyScalar(1.07));
    });
    // A body of even density with these moments has such half axes, but for a common factor.
    const [a, b, c] = platform.principal_moments_kg_m2;
    const half = [b + c - a, a + c - b, a + b - c].map((x) => Math.sqrt(Math.max(x, 1e-4 * (a + b + c))));
    const most = Math.max(...half);
    const body = new THREE.Mesh(new THREE.SphereGeometry(1, 40, 24), new THREE.MeshLambertMaterial({ color: css("--soft"), transparent: true, opacity: 0.28, depthWrite: false }));
    body.scale.set(...half.map((x) => (0.72 * x) / most));
    const axes = platform.principal_axes.map(vector);
    if (axes[0].clone().cross(axes[1]).dot(axes[2]) < 0) axes[2].negate();
    body.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(...axes));
    this.world.add(body);
    const reach = Math.max(1e-9, ...platform.arrows.map((arrow) => (arrow.at_m ? Math.hypot(...arrow.at_m) : 0)));
    platform.arrows.forEach((arrow, k) => {
      const along = vector(arrow.direction).normalize();
      if (arrow.kind === "wheel") {
        const at = along.clone().multiplyScalar(0.55);
        const ring = new THREE.Mesh(new THREE.TorusGeometry(0.17, 0.035, 12, 40), new THREE.MeshLambertMaterial({ color: css("--c4") }));
        ring.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), along);
        ring.position.copy(at);
        this.world.add(ring);
        this.arrow(at.clone(), at.clone().addScaledVector(along, 0.3), css("--c4"));
        this.label(arrow.name, at.clone().addScaledVector(along, 0.36));
      } else if (arrow.kind === "gyro") {
        const ring = new THREE.Mesh(new THREE.TorusGeometry(0.07, 0.012, 8, 32), new THREE.MeshLambertMaterial({ color: css("--c6") }));
        ring.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), along);
        ring.position.copy(along).multiplyScalar(0.82);
        this.world.add(ring);
        this.once(arrow.name, ring.position.clone().addScaledVector(along, 0.12));
      } else if (arrow.kind === "accelerometer") {
        const at = vector(arrow.at_m).multiplyScalar(0.95 / reach);
        this.arrow(at.clone(), at.clone().addScaledVector(along, 0.16), css("--c7"), 0.009);
        this.once(arrow.name, at.clone().add(new THREE.Vector3(0, 0, -0.09)));
      } else if (arrow.kind === "vector") {
        this.arrow(along.clone().multiplyScalar(1.3), along.clone().multiplyScalar(1.5), css("--c6"));
        this.once(arrow.name, along.clone().multiplyScalar(1.58));
      } else {
        const at = vector(arrow.at_m || [0, 0, 0]).multiplyScalar(0.95 / reach);
        this.arrow(at.clone(), at.clone().addScaledVector(along, 0.28), css("--c3"));
        if (platform.arrows.length < 24) this.label(arrow.name, at.clone().addScaledVector(along, 0.32 + 0.02 * (k % 2)));
      }
    });
    if (platform.hinge_axis) {
      const along = vector(platform.hinge_axis).normalize();
      const shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.03, 0.03, 2.2, 16), new THREE.MeshLambertMaterial({ color: css("--c5") }));
      shaft.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along);
      this.world.add(shaft);
      this.label("hinge", along.clone().multiplyScalar(-1.15));
    }
    const offset = vector(platform.gravity_offset_n_m);
    if (offset.length() > 0) {
      const at = offset.clone().normalize().multiplyScalar(0.45);
      const ball = new THREE.Mesh(new THREE.SphereGeometry(0.05, 20, 16), new THREE.MeshLambertMaterial({ color: ink }));
      ball.position.copy(at);
      this.world.add(ball);
      this.label("centre of mass (direction)", at);
    }
  }

  controls(canvas) {
    const { view } = this;
    const turn = (dx, dy) => { view.azimuth -= dx * 0.008; view.elevation = Math.max(-1.5, Math.min(1.5, view.elevation + dy * 0.008)); this.draw(); };
    const zoom = (factor) => { view.distance = Math.max(1.5, Math.min(12, view.distance * factor)); this.draw(); };
    let from = null;
    canvas.addEventListener("pointerdown", (e) => { from = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
    canvas.addEventListener("pointermove", (e) => { if (from) { turn(e.clientX - from[0], e.clientY - from[1]); from = [e.clientX, e.clientY]; } });
    canvas.addEventListener("pointerup", () => (from = null));
    canvas.addEventListener("keydown", (e) => {
      const move = { ArrowLeft: [-20, 0], ArrowRight: [20, 0], ArrowUp: [0, -20], ArrowDown: [0, 20] }[e.key];
      if (move) { e.preventDefault(); turn(...move); }
      if (e.key === "+" || e.key === "=") zoom(0.85);
      if (e.key === "-") zoom(1.18);
    });
  }

  draw() {
    const [width, height] = [this.place.clientWidth, this.place.clientHeight];
    if (!width || !height) return;
    const { azimuth, elevation } = this.view;
    // All of it is seen in a narrow place, too.
    const distance = this.view.distance * Math.max(1, (1.6 * height) / width);
    this.renderer.setPixelRatio(devicePixelRatio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.up.set(0, 0, 1);
    const flat = Math.cos(elevation);
    this.camera.position.set(distance * flat * Math.cos(azimuth), distance * flat * Math.sin(azimuth), distance * Math.sin(elevation));
    this.camera.lookAt(0, 0, 0);
    this.camera.updateProjectionMatrix();
    this.renderer.render(this.world, this.camera);
    for (const { element, at } of this.labels) {
      const seen = at.clone().project(this.camera);
      element.style.transform = `translate(${((seen.x + 1) / 2) * width}px, ${((1 - seen.y) / 2) * height}px) translate(-50%, -50%)`;
    }
  }
}
