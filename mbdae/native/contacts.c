/* Contacts between the steps of a run: how long the next step may be, and whether the last one needs a closer look. Where it does,
   Python looks (`ContactSteps`), with the same rules. */
#include "contacts.h"

/* 0 at rest, where there is no impact. */
static double duration_at(const double *logarithms, double speed) {
  if (speed == 0) return 0;
  const double place = fmin(fmax(8 * (log10(fabs(speed)) + 14), 0), SPEEDS - 1.001);
  const I i = (I)place;
  return exp(logarithms[i] + (place - (double)i) * (logarithms[i + 1] - logarithms[i]));
}

/* Time in which a gap would change by its own size at its rate. */
static double calm_of(const Gap *g) { return g->rate != 0 ? fabs(g->gap / g->rate) : INFINITY; }

/* Largest step (s) from the last accepted point at t: half the way to the surface, or a small part of an impact. */
API double contacts_bound(const Contacts *c, double t) {
  double bound = INFINITY;
  for (I i = 0; i < c->count; i++) {
    const Gap *here = c->here + i, *before = c->before + i;
    const double brief = c->impact * fmin(here->duration, before->duration);
    if (here->gap < 0 && t < c->lasting[i]) bound = fmin(bound, fmax(brief, c->rest * fmin(calm_of(here), calm_of(before))));
    if (here->gap >= 0 && here->rate < 0) bound = fmin(bound, fmax(brief, c->approach * calm_of(here)));
  }
  return fmax(bound, c->round * fabs(t));
}

/* Whether a step of h hides no contact, none is made or lost, and the masses in the durations still hold. */
static int is_calm(const Contacts *c, I i, double h, I moved) {
  const Gap here = c->here[i], end = c->end[i];
  const I near = c->by_joints[i] && (end.gap < 0 || (end.rate < 0 && end.gap < -c->near * end.rate * end.duration));
  if ((near && (moved || !c->known[i])) || (here.gap < 0) != (end.gap < 0)) return 0;
  if (!(here.gap > 0 && h > c->impact * fmin(here.duration, end.duration))) return 1;
  const double drop = fmax(-here.rate, 0) + fmax(end.rate, 0);
  return (1 - c->margin) * fmin(here.gap, end.gap) >= c->slope * h * drop;
}

/* After a step of h that ends at (t, y): 1 where it needs no closer look, 0 where it does, negative where Python raised. */
API int contacts_calm(Contacts *c, double t, double h, const double *y) {
  const int code = c->values(c->scene, 1, &t, y, NULL, c->positions, 2 * c->count, c->pairs);
  if (code) return code < 0 ? code : 0;
  I moved = 0;
  for (I k = 0; k < c->positions; k++) moved |= !(fabs(y[k] - c->at[k]) <= c->reach);
  for (I i = 0; i < c->count; i++) {
    c->end[i] = (Gap){c->pairs[2 * i], c->pairs[2 * i + 1], duration_at(c->logarithms[i], c->pairs[2 * i + 1])};
    if (!is_calm(c, i, h, moved)) return 0;
  }
  return 1;
}

/* Keep the step that was calm: 1 where a penetration differs from that where the Jacobian was evaluated. */
int contacts_keep(Contacts *c) {
  I stiffer = 0;
  memcpy(c->before, c->here, sizeof(Gap) * (size_t)c->count);
  memcpy(c->here, c->end, sizeof(Gap) * (size_t)c->count);
  for (I i = 0; i < c->count; i++) {
    const double now = fmin(c->here[i].gap, 0), was = c->stiff[i];
    c->inside[i] += c->here[i].gap < 0 && c->inside[i] > 0;
    stiffer |= fabs(now - was) > -c->change * fmin(now, was);
  }
  for (I i = 0; i < c->count && stiffer; i++) c->stiff[i] = fmin(c->here[i].gap, 0);
  return stiffer != 0;
}
