
#include <math.h>
void hh(long n,double h,double*s){double x=s[0],y=s[1],u=s[2],v=s[3];double gx=x+2*x*y,gy=y+x*x-y*y;
for(long i=0;i<n;i++){u-=.5*h*gx;v-=.5*h*gy;x+=h*u;y+=h*v;gx=x+2*x*y;gy=y+x*x-y*y;u-=.5*h*gx;v-=.5*h*gy;}s[0]=x;s[1]=y;s[2]=u;s[3]=v;}
void pend(long n,double h,double*s){double x=s[0],u=s[1];double gx=sin(x);
for(long i=0;i<n;i++){u-=.5*h*gx;x+=h*u;gx=sin(x);u-=.5*h*gx;}s[0]=x;s[1]=u;}
void kep(long n,double h,double*s){double x=s[0],y=s[1],u=s[2],v=s[3];double r2=x*x+y*y;double r3=1/(r2*sqrt(r2));double gx=x*r3,gy=y*r3;
for(long i=0;i<n;i++){u-=.5*h*gx;v-=.5*h*gy;x+=h*u;y+=h*v;r2=x*x+y*y;r3=1/(r2*sqrt(r2));gx=x*r3;gy=y*r3;u-=.5*h*gx;v-=.5*h*gy;}s[0]=x;s[1]=y;s[2]=u;s[3]=v;}
