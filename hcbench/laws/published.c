/* The damping chi of F = k x^n (1 + chi x'/v_i) that laws after 1975 have for a restitution e that they are asked
   for; published.py says whose they are. */

#ifndef HCB_PUBLISHED_C
#define HCB_PUBLISHED_C

#include <string.h>

#include "exact_step.c"

#define HCB_PUBLISHED \
  "first-order, herbert-mcwhannell, lee-wang, lankarani-nikravesh, gonthier, zhiying-qishao, flores, hu-guo, " \
  "carvalho-martins, exact"

/* The chi that delivers e: hcb_restitution falls with it, as 1/chi from far out. */
static double exact_chi(double e) {
  double low = 0, high = 1 / e;
  for (int round = 0; round < 200 && high - low > 1e-16 * high; round++) {
    double chi = 0.5 * (low + high);
    if (hcb_restitution(chi) > e) {
      low = chi;
    } else {
      high = chi;
    }
  }
  return 0.5 * (low + high);
}

/* chi of the law called `slug` (one of HCB_PUBLISHED); NaN for no such law, infinite where e = 0 is not for it. */
double hcb_chi(const char* slug, double e) {
  double loss = 1 - e, losses = loss * (1 + e);
  if (!strcmp(slug, "first-order")) return 1.5 * loss;
  if (!strcmp(slug, "herbert-mcwhannell")) return 6 * loss / ((2 * e - 1) * (2 * e - 1) + 3);
  if (!strcmp(slug, "lee-wang")) return 0.75 * loss;
  if (!strcmp(slug, "lankarani-nikravesh")) return 0.75 * losses;
  if (!strcmp(slug, "gonthier")) return losses / e;
  if (!strcmp(slug, "zhiying-qishao")) return 0.75 * losses * exp(2 * loss);
  if (!strcmp(slug, "flores")) return 1.6 * loss / e;
  if (!strcmp(slug, "hu-guo")) return 1.5 * loss / e;
  if (!strcmp(slug, "carvalho-martins")) return 1.5 * loss * (11 - e) / (1 + 9 * e);
  if (!strcmp(slug, "exact")) return e > 0 ? exact_chi(e) : INFINITY;
  return NAN;
}

#endif
