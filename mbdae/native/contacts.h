/* The contacts of a scene over a run, as far as they need no closer look: contacts.c. */
#ifndef MBDAE_CONTACTS_H
#define MBDAE_CONTACTS_H
#include "core.h"

enum { SPEEDS = 161 }; /* at which durations of impacts are known: from 1e-14 m/s (rad/s) on, eight in a decade */

/* Of a contact at one time: gap (m or rad, apart where positive), its rate, duration (s) of an impact at this speed. */
typedef struct { double gap, rate, duration; } Gap;

/* `values` gives gap and rate of each contact one after the other. Letters and numbers are those of `ContactSteps`. */
typedef struct {
  int (*values)(void *scene, I k, const double *t, const double *y, const double *yp, I stride, I count, double *out);
  void *scene;
  I count, positions;
  double (*logarithms)[SPEEDS];                 /* (count): of the durations */
  const I *by_joints, *known;                   /* (count): whether joints add to the mass; whether that is known at `at` */
  const double *at; double reach;               /* (positions): where masses are known, and how far from there they hold */
  Gap *here, *before, *end;                     /* (count) each: at the last step accepted, the one before, the present one */
  double *lasting, *stiff, *pairs; I *inside;   /* (count), pairs (count, 2) */
  double impact, approach, rest, margin, slope, change, near, round;
} Contacts;

API double contacts_bound(const Contacts *c, double t);
API int contacts_calm(Contacts *c, double t, double h, const double *y);
int contacts_keep(Contacts *c);
#endif
