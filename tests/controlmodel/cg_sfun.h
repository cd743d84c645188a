/* Calls an S-function once, as Simulink would: for the tests alone. */
void called(SimStruct *S);
void called(SimStruct *S)
{
    mdlInitializeSizes(S);
    mdlInitializeSampleTimes(S);
    mdlOutputs(S, 0);
    mdlTerminate(S);
}
