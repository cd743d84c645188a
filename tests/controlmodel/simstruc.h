/* What an S-function uses of MathWorks' simstruc.h, for the tests alone: no Simulink here. */
#include <stddef.h>

typedef int int_T;
typedef double real_T;
typedef struct {
    double inputs[5][6], outputs[8][6], work[6];
    int connected[5], widths[2][8], parameters, continuous, discrete, ports[2], times;
    double sample_time, offset;
    const char *error;
} SimStruct;

#define SS_DOUBLE 0
#define INHERITED_SAMPLE_TIME (-1.0)
#define SS_OPTION_EXCEPTION_FREE_CODE 1
#define ssSetNumSFcnParams(S, n) ((S)->parameters = (n))
#define ssGetNumSFcnParams(S) ((S)->parameters)
#define ssGetSFcnParamsCount(S) 0
#define ssSetNumContStates(S, n) ((S)->continuous = (n))
#define ssSetNumDiscStates(S, n) ((S)->discrete = (n))
#define ssSetNumInputPorts(S, n) ((S)->ports[0] = (n))
#define ssSetNumOutputPorts(S, n) ((S)->ports[1] = (n))
#define ssSetInputPortWidth(S, port, n) ((S)->widths[0][port] = (n))
#define ssSetOutputPortWidth(S, port, n) ((S)->widths[1][port] = (n))
#define ssSetInputPortDataType(S, port, type) ((void)(type))
#define ssSetOutputPortDataType(S, port, type) ((void)(type))
#define ssSetInputPortRequiredContiguous(S, port, yes) ((void)(yes))
#define ssSetInputPortDirectFeedThrough(S, port, yes) ((void)(yes))
#define ssSetNumSampleTimes(S, n) ((S)->times = (n))
#define ssSetSampleTime(S, n, time) ((S)->sample_time = (time))
#define ssSetOffsetTime(S, n, time) ((S)->offset = (time))
#define ssSetOptions(S, options) ((void)(options))
#define ssSetErrorStatus(S, text) ((S)->error = (text))
#define ssSetNumRWork(S, n) ((void)(n))
#define ssGetRWork(S) ((S)->work)
#define ssGetInputPortConnected(S, port) ((S)->connected[port])
#define ssGetInputPortSignal(S, port) ((const void *)(S)->inputs[port])
#define ssGetOutputPortSignal(S, port) ((void *)(S)->outputs[port])
