/* What the plug-in uses of Bullet: declarations as in PhysicsClientC_API.h, SharedMemoryPublic.h and b3PluginContext.h
   of protocol 202010061 (pybullet 3.2), found at run time in the library that loads the plug-in, under any path. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <stddef.h>

enum { PROTOCOL = 202010061, WORLD_FRAME = 2, MULTI_BODY = 2, STATE_COMPLETED = 21, DOFS = 128 };
enum { CONSTRAINT_INFO = 64 /* of a command on a constraint: tell of it */ };
enum { SPHERE = 2, BOX = 3, PLANE = 6 };
enum { REVOLUTE, PRISMATIC, SPHERICAL, PLANAR, FIXED, POINT_TO_POINT, GEAR };
enum { SIMULATION_RESET = 0, BODY_REMOVED = 2, LINK_DYNAMICS_CHANGED = 5, TRANSFORM_CHANGED = 7, SIMULATION_STEPPED = 8 };
enum { COMPUTE_LINK_VELOCITY = 1, PROCESS_COMMAND = 5 /* its place among the server's virtual functions */ };

typedef struct {
  double mass, inertia[3], frame[7], friction, rolling, spinning, restitution, stiffness, damping;
  int activation, type;
  double angular_damping, linear_damping, ccd_radius, processing_threshold;
  int anchor;
  double margin;
  int dynamic_type;
} b3DynamicsInfo;

typedef struct {
  char link_name[1024], joint_name[1024];
  int type, q_index, u_index, index, flags;
  double damping, friction, lower, upper, max_force, max_velocity, parent_frame[7], child_frame[7], axis[3];
  int parent, q_size, u_size;
} b3JointInfo;

typedef struct {
  int flags, body[2], link[2];
  double on[2][3], normal[3], distance, force, friction1, friction2, direction1[3], direction2[3];
} b3Contact; /* the normal points at the first body */

typedef struct {
  int count;
  b3Contact* points;
} b3Contacts;

typedef struct {
  int body, link, type;
  double size[3], frame[7];
  char file[1024];
} b3Shape;

typedef struct {
  int count;
  b3Shape* shapes;
} b3Shapes;

typedef struct {
  int body[4]; /* parent, its link, child, its link; child -1: the world */
  double frame[2][7], axis[3]; /* in the frames of the centres of mass of parent and child; of the parent */
  int type;
  double max_force;
  int id;
  double gear_ratio;
  int gear_link;
  double target, erp;
} b3Constraint;

typedef struct { /* the head of each command */
  int type;
  unsigned long long time;
  int sequence, flags;
} b3Command;

typedef struct { /* the head of each status, and what two of them tell */
  int type;
  unsigned long long time;
  int sequence, stream_bytes;
  char* stream;
  int flags;
  union {
    b3Constraint constraint;
    struct {
      int bodies, first_bodies[512], constraints;
    } counts; /* the numbers themselves, bodies first, are in the stream */
  } of;
} b3Status;

typedef struct {
  double time_step, time, gravity[3];
  int substeps, iterations;
  double warm[2];
  int real_time, split_impulse;
  double split_threshold, breaking_threshold;
  int flags;
  double contact_erp;
  char rest[1024];
} b3Parameters;

typedef struct { /* as the server writes it */
  double q[DOFS], qdot[DOFS], reaction[6 * DOFS], motor[DOFS], motors[DOFS], link[DOFS][7], velocity[DOFS][6];
  double frames[8 * DOFS];
} b3State;

typedef struct {
  int type;
  union {
    int body;
    struct {
      int body, link;
      double pose[7]; /* of its centre of mass */
    } moved;
    double size[34];
  } of;
} b3Notification;

typedef struct {
  char text[1024];
  int ints, value[128], floats;
  double floats_[128];
} b3Arguments;

typedef struct {
  int type, length;
  const char* data;
} b3Data;

typedef struct {
  void *client, *user;
  b3Data* data;
  const void* vr;
  int vrs;
  const void* keys;
  int keys_;
  const void* mouse;
  int mice;
  const b3Notification* notifications;
  int count;
  void* server;
} b3Context;

#define B3_FUNCTIONS(X) \
  X(void*, b3SubmitClientCommandAndWaitStatus, (void*, void*)) X(int, b3GetStatusType, (void*)) \
  X(void*, b3InitRequestPhysicsParamCommand, (void*)) \
  X(int, b3GetStatusPhysicsSimulationParameters, (void*, b3Parameters*)) X(void*, b3InitPhysicsParamCommand, (void*)) \
  X(int, b3PhysicsParamSetDefaultContactERP, (void*, double)) \
  X(void*, b3InitSyncBodyInfoCommand, (void*)) X(void*, b3InitRequestBodyInfoCommand, (void*, int)) \
  X(int, b3GetNumJoints, (void*, int)) \
  X(void*, b3InitGetUserConstraintStateCommand, (void*, int)) \
  X(int, b3GetJointInfo, (void*, int, int, b3JointInfo*)) \
  X(void*, b3GetDynamicsInfoCommandInit, (void*, int, int)) X(int, b3GetDynamicsInfo, (void*, b3DynamicsInfo*)) \
  X(void*, b3RequestActualStateCommandInit, (void*, int)) \
  X(int, b3RequestActualStateCommandComputeLinkVelocity, (void*, int)) \
  X(int, b3RequestActualStateCommandComputeForwardKinematics, (void*, int)) \
  X(void*, b3RequestCollisionInfoCommandInit, (void*, int)) \
  X(int, b3GetStatusAABB, (void*, int, double*, double*)) \
  X(void*, b3InitRequestCollisionShapeInformation, (void*, int, int)) \
  X(void, b3GetCollisionShapeInformation, (void*, b3Shapes*)) X(void*, b3CollisionFilterCommandInit, (void*)) \
  X(void, b3SetCollisionFilterPair, (void*, int, int, int, int, int)) \
  X(void*, b3InitPerformCollisionDetectionCommand, (void*)) \
  X(void*, b3InitRequestContactPointInformation, (void*)) X(void, b3SetContactFilterBodyA, (void*, int)) \
  X(void, b3SetContactFilterBodyB, (void*, int)) X(void, b3GetContactPointInformation, (void*, b3Contacts*)) \
  X(void*, b3InitClosestDistanceQuery, (void*)) X(void, b3SetClosestDistanceFilterBodyA, (void*, int)) \
  X(void, b3SetClosestDistanceFilterBodyB, (void*, int)) X(void, b3SetClosestDistanceFilterLinkA, (void*, int)) \
  X(void, b3SetClosestDistanceFilterLinkB, (void*, int)) X(void, b3SetClosestDistanceThreshold, (void*, double)) \
  X(void*, b3InitStepSimulationCommand, (void*)) X(void*, b3ApplyExternalForceCommandInit, (void*)) \
  X(void, b3ApplyExternalForce, (void*, int, int, const double*, const double*, int))

#define DECLARE(type, name, arguments) static type(*name) arguments;
B3_FUNCTIONS(DECLARE)

/* The name of what is missing in the library that `address` is in; NULL if all is there. */
static const char* find_functions(void* address) {
  Dl_info in;
  void* library = dladdr(address, &in) ? dlopen(in.dli_fname, RTLD_LAZY | RTLD_NOLOAD) : NULL;
  if (!library) return "its library";
#define FIND(type, name, arguments) \
  if (!(*(void**)&name = dlsym(library, #name))) return #name;
  B3_FUNCTIONS(FIND)
  return NULL;
}
