// SPDX-License-Identifier: Apache-2.0
// Rapier in the cases of hcbench, without Python: node rapier.mjs hcbench-cases-1.json > rapier.json
// Needs: npm install @dimforge/rapier3d-compat. Nothing is chosen but restitution and friction.
import { readFileSync } from "node:fs";
import * as packaged from "@dimforge/rapier3d-compat";

// Its versions export one object, or all of its parts.
const Rapier = packaged.default ?? packaged;

await Rapier.init();
const vector = ([x, y, z]) => ({ x, y, z }), numbers = ({ x, y, z }) => [x, y, z];

function shape({ shape, radius, half, vertices }) {
  if (shape === "sphere") return Rapier.ColliderDesc.ball(radius);
  if (shape === "box") return Rapier.ColliderDesc.cuboid(...half);
  return Rapier.ColliderDesc.convexHull(new Float32Array(vertices.flat()));
}

function run({ world: shared, body: same }, { world: own, record }) {
  const asked = { ...shared, ...own, bodies: own.bodies.map((body) => ({ ...same, ...body })) };
  const world = new Rapier.World(vector(asked.gravity)), moving = [], states = [];
  world.timestep = asked.timestep;
  // Rapier averages the numbers of two colliders, so each has those of the pair.
  const [e, floorE] = asked.materials ?? [asked.restitution, asked.restitution];
  for (const body of asked.bodies) {
    const kind = body.fixed ? Rapier.RigidBodyDesc.fixed() : Rapier.RigidBodyDesc.dynamic();
    const made = world.createRigidBody(kind.setTranslation(...body.position).setCanSleep(false));
    const solid = shape(body).setMass(body.mass).setRestitution(e).setFriction(asked.friction);
    world.createCollider(solid, made);
    if (body.fixed) continue;
    made.setLinvel(vector(body.velocity), true);
    made.setAngvel(vector(body.spin), true);
    moving.push(made);
  }
  if (asked.floor) {
    const slab = Rapier.ColliderDesc.cuboid(9, 9, 1).setTranslation(0, 0, -1);
    world.createCollider(slab.setRestitution(floorE).setFriction(asked.friction));
  }
  const state = (b) => [b.translation(), b.linvel(), b.angvel()].flatMap(numbers);
  for (let step = 0; step <= record.at(-1)[1]; step++) {
    if (step) world.step();
    if (record.some(([first, last]) => first <= step && step <= last)) states.push([step, ...moving.map(state)]);
  }
  world.free();
  return { states };
}

const cases = JSON.parse(readFileSync(process.argv[2]));
const engine = { name: "rapier-js-stock", version: Rapier.version(), combine: "average" };
const runs = Object.fromEntries(cases.cases.map((each) => [each.id, each.runs.map((one) => run(each, one))]));
console.log(JSON.stringify({ format: 1, set: cases.set, engine, runs }));
