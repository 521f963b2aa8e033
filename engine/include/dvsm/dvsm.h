/* libdvsm: decoder-only view synthesis on a CPU. One header to include. */
#ifndef DVSM_DVSM_H
#define DVSM_DVSM_H

#include "dvsm/camera.h"
#include "dvsm/engine.h"
#include "dvsm/model.h"
#include "dvsm/scene.h"
#include "dvsm/status.h"

#endif
