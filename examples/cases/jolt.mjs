// SPDX-License-Identifier: Apache-2.0
// Jolt in the cases of hcbench, without Python: node jolt.mjs hcbench-cases-1.json > jolt.json
// With "stock" behind, nothing is chosen but restitution and friction.
// Needs: npm install jolt-physics@1.1.0. Judge the results by: hcbench cases score jolt.json
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import initJolt from "jolt-physics/wasm-compat";

const Jolt = await initJolt();
const { version } = createRequire(import.meta.url)("jolt-physics/package.json");
const settings = new Jolt.JoltSettings();
const layers = (settings.mObjectLayerPairFilter = new Jolt.ObjectLayerPairFilterTable(1));
layers.EnableCollision(0, 0);
const phases = (settings.mBroadPhaseLayerInterface = new Jolt.BroadPhaseLayerInterfaceTable(1, 1));
phases.MapObjectToBroadPhaseLayer(0, new Jolt.BroadPhaseLayer(0));
settings.mObjectVsBroadPhaseLayerFilter = new Jolt.ObjectVsBroadPhaseLayerFilterTable(phases, 1, layers, 1);
const engine = new Jolt.JoltInterface(settings);
const system = engine.GetPhysicsSystem(), bodies = system.GetBodyInterface();
const physics = system.GetPhysicsSettings(), isStock = process.argv[3] === "stock";
// 1 m/s and 20 mm by default.
if (!isStock) Object.assign(physics, { mMinVelocityForRestitution: 0, mPenetrationSlop: 1e-4 });
system.SetPhysicsSettings(physics);

const vector = (x) => new Jolt.Vec3(...x), numbers = (v) => [v.GetX(), v.GetY(), v.GetZ()];
function add(shape, body, motion, restitution, friction) {
  const place = new Jolt.RVec3(...body.position), turn = new Jolt.Quat(0, 0, 0, 1);
  const made = new Jolt.BodyCreationSettings(shape, place, turn, motion, 0);
  const free = { mLinearDamping: 0, mAngularDamping: 0, mAllowSleeping: false, mMaxAngularVelocity: 1e6 };
  Object.assign(made, { mRestitution: restitution, mFriction: friction, ...(isStock ? {} : free) });
  made.mOverrideMassProperties = Jolt.EOverrideMassProperties_CalculateInertia;
  made.mMassPropertiesOverride.mMass = body.mass;
  made.mLinearVelocity = vector(body.velocity ?? [0, 0, 0]);
  made.mAngularVelocity = vector(body.spin ?? [0, 0, 0]);
  const added = bodies.CreateBody(made);
  bodies.AddBody(added.GetID(), Jolt.EActivation_Activate);
  return added;
}

function run({ world: shared, body: same }, { world: own, record }) {
  const world = { ...shared, ...own, bodies: own.bodies.map((body) => ({ ...same, ...body })) };
  if (world.bodies.some((body) => body.vertices)) return { unsupported: "no mesh in this adapter" };
  const [e, floorE] = world.materials ?? [world.restitution, world.restitution];
  system.SetGravity(vector(world.gravity));
  const all = world.bodies.map((body) => {
    const shape = body.half ? new Jolt.BoxShape(vector(body.half), 0) : new Jolt.SphereShape(body.radius);
    const motion = body.fixed ? Jolt.EMotionType_Static : Jolt.EMotionType_Dynamic;
    return add(shape, body, motion, e, world.friction);
  });
  const moving = all.filter((_, i) => !world.bodies[i].fixed), states = [];
  const floor = { position: [0, 0, -1], mass: 1 }, ground = new Jolt.BoxShape(vector([9, 9, 1]), 0);
  if (world.floor) all.push(add(ground, floor, Jolt.EMotionType_Static, floorE, world.friction));
  const state = (b) => [b.GetPosition(), b.GetLinearVelocity(), b.GetAngularVelocity()].flatMap(numbers);
  for (let step = 0; step <= record.at(-1)[1]; step++) {
    if (step) engine.Step(world.timestep, 1);
    if (record.some(([first, last]) => first <= step && step <= last)) states.push([step, ...moving.map(state)]);
  }
  for (const body of all) bodies.RemoveBody(body.GetID()), bodies.DestroyBody(body.GetID());
  return { states };
}

const cases = JSON.parse(readFileSync(process.argv[2])), name = isStock ? "jolt-stock" : "jolt";
const runs = Object.fromEntries(cases.cases.map((each) => [each.id, each.runs.map((one) => run(each, one))]));
console.log(JSON.stringify({ format: 1, set: cases.set, engine: { name, version, combine: "maximum" }, runs }));
