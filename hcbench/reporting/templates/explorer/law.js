// The law of Hunt and Crossley (1975), eq. (16): F = k x^n (1 + a v) with a = (3/2) α, in closed form; SI.
//
// With 1 + a v = exp(u) and h(u) = exp(u) - 1 - u one impact runs along
//   k x^(n+1)/(n+1) = (m/a²) (h(u_i) - h(u)),
// so that u falls from u_i at touch to the negative root of h(u) = h(u_i) at parting.

// exp(u) - 1 - u, without losing digits near 0.
function curvature(u) {
  if (Math.abs(u) > 0.02) return Math.expm1(u) - u;
  return (u * u / 2) * (1 + (u / 3) * (1 + (u / 4) * (1 + (u / 5) * (1 + (u / 6) * (1 + u / 7)))));
}

// The u with h(u) = q²/2 and the sign of q. h is convex, so Newton's steps from further out all go one way.
function rateOf(q) {
  const size = Math.abs(q), half = q * q / 2;
  if (size < 1e-8) return q;
  let u = q > 0 ? Math.log1p(size + half) : -(size + half);
  for (let i = 0; i < 60; i++) {
    const step = (curvature(u) - half) / Math.expm1(u);
    u -= step;
    if (Math.abs(step) < 1e-15 * Math.abs(u)) break;
  }
  return u;
}

// e at an impact speed, m/s, for α, s/m.
function lawRestitution(alpha, speed) {
  const damping = 1.5 * alpha * speed;
  if (damping < 1e-8) return 1 - alpha * speed;
  const q = Math.sqrt(2 * curvature(Math.log1p(damping)));
  return -Math.expm1(rateOf(-q)) / damping;
}

// One loop: {t, x, f}, arrays over `count` + 1 points from touch to parting. body: {k, n, m}.
function lawLoop(body, alpha, speed, count = 160) {
  const {k, n, m} = body, a = Math.max(1.5 * alpha, 1e-6 / speed);  // lossless is the limit
  const energy = curvature(Math.log1p(a * speed)), q = Math.sqrt(2 * energy);
  const deepest = ((n + 1) * m * energy / (a * a * k)) ** (1 / (n + 1));
  const p = (n - 1) / (n + 1), scale = 2 * deepest * a / ((n + 1) * q);
  const loop = {t: [], x: [], f: []};
  let time = 0;
  for (let i = 0; i <= count; i++) {
    const angle = Math.PI * i / count, inside = i > 0 && i < count;
    const x = inside ? deepest * Math.sin(angle) ** (2 / (n + 1)) : 0;
    loop.t.push(scale * time);
    loop.x.push(x);
    loop.f.push(k * x ** n * Math.exp(rateOf(q * Math.cos(angle))));
    // ∫ sin^-p (q/y) dθ over the next panel: the ends' power exactly, what is smooth at its middle.
    const middle = angle + Math.PI / count / 2, end = Math.min(middle, Math.PI - middle);
    const from = end - Math.PI / count / 2, to = end + Math.PI / count / 2;
    const power = (to ** (1 - p) - Math.max(from, 0) ** (1 - p)) / (1 - p);
    const here = q * Math.cos(middle), ratio = Math.abs(here) < 1e-8 ? 1 : here / Math.expm1(rateOf(here));
    time += power * (Math.sin(middle) / end) ** -p * ratio;
  }
  return loop;
}

// A drop from `height`, m, under `gravity`, m/s²: {touch, parting, height}, arrays over `count` bounces.
function lawDrop(body, alpha, height, gravity, count = 10) {
  const drop = {touch: [], parting: [], height: []};
  let time = Math.sqrt(2 * height / gravity), speed = gravity * time;
  for (let i = 0; i < count; i++) {
    drop.touch.push(time);
    time += lawLoop(body, alpha, speed).t.at(-1);
    drop.parting.push(time);
    speed *= lawRestitution(alpha, speed);
    drop.height.push(speed * speed / (2 * gravity));
    time += 2 * speed / gravity;
  }
  return drop;
}
