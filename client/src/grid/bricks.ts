/** Steps along each axis of an adaptive grid's brick, as lightwell.field.bricks has them: it has one node more. */
export const STEPS = 4;
